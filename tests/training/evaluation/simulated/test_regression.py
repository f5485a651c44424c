"""Maps by regression, by what must hold at their solutions."""

from __future__ import annotations

import numpy as np
import pytest

from echogrid.core.evidence.raster import GridSpec
from echogrid_training.evaluation.simulated.regression import GaussianProcess, HilbertMap, kernel, on_cells

SPEC = GridSpec(16, 0.5)


@pytest.fixture
def points() -> tuple[np.ndarray, np.ndarray]:
    """In the middle of different cells, occupied on the left."""
    centres = SPEC.centres().reshape(-1, 2)[np.random.default_rng(0).permutation(256)[:60]]
    return centres, np.where(centres[:, 1] > 1.0, 1.0, -1.0)


def test_the_kernel_on_cells_is_that_between_points(points: tuple[np.ndarray, np.ndarray]) -> None:
    centres, values = points
    cells = SPEC.centres().reshape(-1, 2)
    apart = ((cells[:, None] - centres[None]) ** 2).sum(axis=2)
    expected = np.exp(-apart / (2 * 0.8**2)) @ values
    np.testing.assert_allclose(on_cells(centres, values, 0.8, SPEC).reshape(-1), expected, atol=1e-5)


def test_a_gaussian_process_without_noise_says_what_it_was_told(points: tuple[np.ndarray, np.ndarray]) -> None:
    centres, values = points
    told = GaussianProcess(0.5, 1e-3)(centres, values, SPEC).reshape(-1)[SPEC.locate(centres)]
    np.testing.assert_allclose(told, values, atol=1e-2)


def test_a_gaussian_process_is_the_best_weighting(points: tuple[np.ndarray, np.ndarray]) -> None:
    """k (K + noise² 1)⁻¹ y, by a plain solver."""
    centres, values = points
    apart = ((SPEC.centres().reshape(-1, 1, 2) - centres[None]) ** 2).sum(axis=2)
    weights = np.linalg.inv(kernel(centres, 1.2) + 0.25 * np.eye(60)) @ values
    expected = np.exp(-apart / (2 * 1.2**2)) @ weights
    np.testing.assert_allclose(GaussianProcess(1.2, 0.5)(centres, values, SPEC).reshape(-1), expected, atol=1e-4)


def test_a_hilbert_map_is_where_no_direction_is_better(points: tuple[np.ndarray, np.ndarray]) -> None:
    """f = K w with ridge w = occupied - p(f) at every point: the gradient of penalty and likelihood in balance."""
    centres, values = points
    for ridge in (0.05, 1.0):
        f = HilbertMap(0.8, ridge)(centres, values, SPEC).reshape(-1)[SPEC.locate(centres)].astype(float)
        left = (values > 0) - 1 / (1 + np.exp(-f))
        np.testing.assert_allclose(f, kernel(centres, 0.8) @ left / ridge, atol=2e-3 / ridge)


def test_far_from_all_points_nothing_is_known(points: tuple[np.ndarray, np.ndarray]) -> None:
    one = np.array([[-3.0, -3.0]]), np.array([1.0])
    for model in (GaussianProcess(0.5, 0.5), HilbertMap(0.5, 0.1)):
        said = model(*one, SPEC)
        assert abs(said[-1, -1]) < 1e-6
        assert said.max() == said.reshape(-1)[SPEC.locate(one[0])[0]]
