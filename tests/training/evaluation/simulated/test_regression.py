"""Maps by regression, by what must hold at their solutions, and against plain solvers."""

from __future__ import annotations

import numpy as np
import pytest

from echogrid.core.evidence.raster import GridSpec
from echogrid_training.evaluation.simulated.regression import GaussianProcess, HilbertMap, Kernel, solved

SPEC = GridSpec(16, 0.5)
CENTRES = SPEC.centres().reshape(-1, 2)


@pytest.fixture
def seen() -> tuple[np.ndarray, np.ndarray]:
    """60 cells, occupied on the left, and ten of them once more, as the other kind."""
    cells = np.random.default_rng(0).permutation(256)[:60]
    values = np.where(CENTRES[cells, 1] > 1.0, 1.0, -1.0)
    return np.concatenate((cells, cells[:10])), np.concatenate((values, -values[:10]))


def gram(cells: np.ndarray, others: np.ndarray, length: float) -> np.ndarray:
    """The kernel between the centres of cells (N,) and of others (M,), a pair at a time."""
    return np.exp(-((CENTRES[cells][:, None] - CENTRES[others][None]) ** 2).sum(axis=2) / (2 * length**2))


def test_the_kernel_is_that_between_centres(seen: tuple[np.ndarray, np.ndarray]) -> None:
    cells, values = seen
    kernel = Kernel(cells, 0.8, SPEC)
    np.testing.assert_allclose(kernel(values), gram(cells, cells, 0.8) @ values, atol=1e-9)
    np.testing.assert_allclose(kernel.on_cells(values).reshape(-1), gram(np.arange(256), cells, 0.8) @ values, atol=1e-5)


def test_what_is_solved_is_the_solution() -> None:
    rng = np.random.default_rng(1)
    half = rng.normal(size=(40, 40))
    matrix, right = half @ half.T + np.eye(40), rng.normal(size=40)
    for start in (None, rng.normal(size=40)):
        np.testing.assert_allclose(solved(lambda v: matrix @ v, right, start), np.linalg.solve(matrix, right), atol=1e-5)
    assert not solved(lambda v: matrix @ v, np.zeros(40)).any()


def test_a_gaussian_process_without_noise_says_what_it_was_told(seen: tuple[np.ndarray, np.ndarray]) -> None:
    cells, values = (part[:60] for part in seen)
    told = GaussianProcess(0.5, 1e-2)(cells, values, SPEC).reshape(-1)[cells]
    np.testing.assert_allclose(told, values, atol=1e-2)


@pytest.mark.parametrize("length", [0.3, 1.2])
def test_a_gaussian_process_is_the_best_weighting(seen: tuple[np.ndarray, np.ndarray], length: float) -> None:
    """k (K + noise² 1)⁻¹ y, by a plain solver."""
    cells, values = seen
    weights = np.linalg.inv(gram(cells, cells, length) + 0.25 * np.eye(70)) @ values
    expected = gram(np.arange(256), cells, length) @ weights
    np.testing.assert_allclose(GaussianProcess(length, 0.5)(cells, values, SPEC).reshape(-1), expected, atol=1e-4)


def test_a_hilbert_map_is_where_no_direction_is_better(seen: tuple[np.ndarray, np.ndarray]) -> None:
    """f = K w with ridge w = occupied - p(f) at every observation: the gradient of penalty and likelihood in balance."""
    cells, values = seen
    for ridge in (0.05, 1.0):
        f = HilbertMap(0.8, ridge)(cells, values, SPEC).reshape(-1)[cells].astype(float)
        left = (values > 0) - 1 / (1 + np.exp(-f))
        np.testing.assert_allclose(f, gram(cells, cells, 0.8) @ left / ridge, atol=2e-3 / ridge)


def test_far_from_all_observations_nothing_is_known() -> None:
    one = np.array([18]), np.array([1.0])
    for model in (GaussianProcess(0.5, 0.5), HilbertMap(0.5, 0.1)):
        said = model(*one, SPEC)
        assert abs(said[-1, -1]) < 1e-6
        assert said.max() == said.reshape(-1)[18]
