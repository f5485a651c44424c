"""Maps at true poses: by either rule what was put in comes out; and what a map is worth, cell by cell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.motion.se2 import SE2
from echogrid_training.learning.dataset import SPEC
from echogrid_training.paper.true_pose_map import CLAMP, Rule, map_errors, mapped, way_length
from echogrid_training.truth.ground_truth import TruthMap


@pytest.fixture
def truth() -> TruthMap:
    log_odds = np.random.default_rng(1).uniform(-1.0, 1.0, (150, 190)).astype(np.float32)
    return TruthMap(log_odds, (-80 * SPEC.cell, -70 * SPEC.cell), SPEC.cell)


@pytest.mark.parametrize("rule", ["endless", "sum", "looks"])
def test_the_truth_along_the_way_makes_the_true_map(truth: TruthMap, rule: Rule) -> None:
    """At poses on the grid's lines a patch needs no interpolation: the mean of the looks is the truth, the sum n times that, or what of
    it is within the clamp."""
    poses = [SE2(step * 4 * SPEC.cell, 0.0, 0.0) for step in range(6)]
    answers = np.stack([truth.patch(pose, SPEC) for pose in poses])
    looks = np.zeros(truth.log_odds.shape)
    for step in range(6):  # base lies in the middle of 128 x 128 cells, 80 columns and 70 rows from the map's corner
        looks[70 - 64 : 70 + 64, 80 + 4 * step - 64 : 80 + 4 * step + 64] += 1
    expected = {"endless": looks * truth.log_odds, "looks": (looks > 0) * truth.log_odds}
    expected["sum"] = np.clip(expected["endless"], -CLAMP, CLAMP)
    np.testing.assert_allclose(mapped(answers, poses, truth, rule), expected[rule], atol=1e-4)


def test_a_prior_said_again_and_again_is_sure_only_as_a_sum(truth: TruthMap) -> None:
    answers = np.full((20, SPEC.cells, SPEC.cells), -0.4, np.float32)
    poses = [SE2(0.1 * step, 0.02 * step, 0.03 * step) for step in range(20)]
    middle = np.s_[60:80, 70:90]
    np.testing.assert_allclose(mapped(answers, poses, truth, "sum")[middle], -CLAMP)
    np.testing.assert_allclose(mapped(answers, poses, truth, "endless")[middle], 20 * -0.4, atol=1e-4)
    np.testing.assert_allclose(mapped(answers, poses, truth, "looks")[middle], -0.4, atol=1e-5)


def maps(seed: int) -> tuple[LogOdds, LogOdds]:
    """One that knows something of the other; both have unknown cells."""
    rng = np.random.default_rng(seed)
    truth = rng.choice(np.array((-2.0, 0.0, 3.0), np.float32), (40, 50), p=(0.6, 0.2, 0.2))
    said = (truth + rng.normal(0.0, 3.0, truth.shape)).astype(np.float32)
    return np.where(rng.uniform(size=said.shape) < 0.1, np.float32(0), said), truth


def test_errors_cell_by_cell() -> None:
    said, truth = maps(2)
    cells = [(z, true > 0) for z, true in zip(said.ravel().tolist(), truth.ravel().tolist(), strict=True) if z and true]
    sure = [(z > 0) == occupied for z, occupied in cells if abs(z) >= CLAMP]
    bits = [-math.log2(1 / (1 + math.exp(-z if occupied else z))) for z, occupied in cells]
    share = sum(occupied for _, occupied in cells) / len(cells)
    errors = map_errors(said, truth)
    assert errors.sure == pytest.approx(len(sure) / len(cells))
    assert errors.sure_and_wrong == pytest.approx(sure.count(False) / len(sure))
    assert errors.bits == pytest.approx(sum(bits) / len(bits))
    assert errors.least == pytest.approx(-share * math.log2(share) - (1 - share) * math.log2(1 - share))
    assert errors.fitted_bits < min(errors.bits, errors.least)


def test_a_shift_by_class_weights_costs_nothing_after_the_fit() -> None:
    said, truth = maps(3)
    shifted = np.where(said != 0, 2 * said - 1.5, np.float32(0)).astype(np.float32)
    assert map_errors(shifted, truth).bits > map_errors(said, truth).bits
    assert map_errors(shifted, truth).fitted_bits == pytest.approx(map_errors(said, truth).fitted_bits, abs=1e-6)


def test_maps_without_a_cell_in_common_have_no_errors() -> None:
    said, truth = maps(4)
    assert math.isnan(map_errors(said, np.zeros_like(truth)).bits)
    assert math.isnan(map_errors(np.where(said != 0, np.float32(0.1), np.float32(0)), truth).sure_and_wrong)


def test_the_way_round_a_circle() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 2000)
    assert way_length(np.stack((5 * np.cos(angle), 5 * np.sin(angle), angle), axis=1)) == pytest.approx(10 * np.pi, rel=1e-4)
