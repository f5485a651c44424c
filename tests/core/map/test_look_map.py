"""The map of mean looks against lists of what each cell was told, and beside the paper's sum."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import DOUBT, HIT, KNOWN, LEAST_DOUBT, MOST_LOOKS, RESERVE, STEP, SURE, TURN, UPDATES, Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import SIDE
from echogrid.core.motion.se2 import IDENTITY, SE2

SPEC = GridSpec(cells=10, cell=0.25)
LEARNED = Calibration(1.0, 0.0)


def said(log_odds: float, weight: float = 1.0, geometric: float = 0.0) -> np.ndarray:
    """(3, H, W), the same everywhere."""
    return np.stack([np.full((SPEC.cells, SPEC.cells), value, dtype=np.float32) for value in (log_odds, weight, geometric)])


def told(log_odds: float, weight: float = 1.0, geometric: float = 0.0, of: Calibration = LEARNED, times: int = 1) -> float:
    """What the cell in the middle reads after being told so."""
    occupancy = LookMap(SPEC, of)
    for _ in range(times):
        occupancy.integrate(said(log_odds, weight, geometric), IDENTITY)
    return float(occupancy.window(0, 0, 1, 1)[0, 0])


@pytest.mark.parametrize("seed", range(4))
def test_a_cell_reads_the_weighted_mean_of_what_it_was_told(seed: int) -> None:
    """Poses that lie on the cells, so that no cell is blended: each keeps a list, and reads from it."""
    rng = np.random.default_rng(seed)
    of = Calibration(1.7, -0.4)
    occupancy = LookMap(SPEC, of, clamp=2.0)
    lists: dict[tuple[int, int], list[np.ndarray]] = {}
    for _ in range(20):
        row, column = rng.integers(-8, 8, 2)
        planes = np.stack((rng.normal(0, 2, (10, 10)), rng.uniform(0.05, 1, (10, 10)) ** 3, rng.normal(0, 1, (10, 10))))
        planes[2][rng.uniform(size=(10, 10)) < 0.8] = 0
        occupancy.integrate(planes.astype(np.float32), SE2(column * SPEC.cell, row * SPEC.cell, 0.0))
        for i, j in np.ndindex(10, 10):
            lists.setdefault((row + i - 5, column + j - 5), []).append(planes[:, i, j])
    found = occupancy.window(-20, -20, 40, 40)
    unknown = 0
    for i, j in np.ndindex(40, 40):
        answers = lists.get((i - 20, j - 20), [])
        geometric = 0.0
        for _, _, added in answers:
            geometric = float(np.clip(geometric + added, -2.0, 2.0))
        weight = sum(w for _, w, _ in answers)
        if answers and (weight >= KNOWN * len(answers) or geometric):
            expected = 1.7 * sum(z * w for z, w, _ in answers) / weight - 0.4
            if expected < -SURE:
                expected = (expected * weight / UPDATES - SURE * RESERVE) / (weight / UPDATES + RESERVE)
            if geometric > HIT:
                expected = max(expected, -DOUBT + (DOUBT - LEAST_DOUBT) * geometric / 2.0)
            elif geometric > 0:
                expected = max(expected, -SURE)
            assert found[i, j] == pytest.approx(expected, abs=1e-4)
        else:
            unknown += 1
            assert found[i, j] == 0
    assert 100 < unknown < 1500


def test_a_standing_car_changes_nothing_after_four_updates() -> None:
    occupancy = LookMap(SPEC, LEARNED)
    rng = np.random.default_rng(1)
    states = []
    for _ in range(10):
        if occupancy.takes(SE2(1.0, 2.0, 0.5)):
            occupancy.integrate(rng.uniform(0, 1, (3, 10, 10)).astype(np.float32), SE2(1.0, 2.0, 0.5))
        states.append(occupancy.window_of_layers(-20, -20, 60, 60).tobytes())
    assert [states[n] != states[n - 1] for n in range(1, 10)] == [True] * 3 + [False] * 6


def test_a_look_begins_every_half_metre_or_three_degrees() -> None:
    occupancy = LookMap(SPEC, LEARNED)
    way = [occupancy.takes(SE2(0.0, 0.0625 * n, 0.3)) for n in range(24)]  # eight updates a look, sideways
    assert way == ([True] * UPDATES + [False] * (8 - UPDATES)) * 3
    yaw = 0.3 + TURN * 1.0001
    turned = [occupancy.takes(SE2(0.0, 0.0625 * 23, yaw + TURN / 5.9999 * n)) for n in range(12)]
    assert turned == [True] * 4 + [False] * 2 + [True] * 4 + [False] * 2
    fast = [occupancy.takes(SE2(3.0 * n, 10.0, 0.0)) for n in range(9)]
    assert all(fast)
    assert (STEP, math.degrees(TURN), UPDATES) == (0.5, pytest.approx(3.0), 4)


def test_a_look_is_as_much_as_four_updates() -> None:
    """However fast the car is: layers hold sums of a quarter each."""
    occupancy = LookMap(SPEC, LEARNED)
    for _ in range(UPDATES):
        occupancy.integrate(said(2.0, 0.5), IDENTITY)
    total, weight, looks, geometric = occupancy.window_of_layers(0, 0, 1, 1)[:, 0, 0]
    assert (total, weight, looks, geometric) == (1.0, 0.5, 1.0, 0.0)


def test_what_is_older_than_twenty_looks_fades() -> None:
    """A wall that was taken down: the mean goes from 3 to -1 as a recursion by hand says, and never holds more than 20 looks."""
    occupancy = LookMap(SPEC, LEARNED)
    for _ in range(300):
        occupancy.integrate(said(3.0), IDENTITY)
    assert occupancy.window_of_layers(0, 0, 1, 1)[2, 0, 0] == pytest.approx(MOST_LOOKS, rel=1e-5)
    mean = 3.0
    for _ in range(200):
        occupancy.integrate(said(-1.0), IDENTITY)
        mean = (MOST_LOOKS * mean + 0.25 * -1.0) / (MOST_LOOKS + 0.25)
        assert occupancy.window(0, 0, 1, 1)[0, 0] == pytest.approx(mean, abs=2e-3)
    assert mean < -0.6
    assert occupancy.window_of_layers(0, 0, 1, 1)[2, 0, 0] == pytest.approx(MOST_LOOKS, rel=1e-5)


def test_a_repeated_prior_saturates_the_sum_and_not_the_mean() -> None:
    """A network that says 0.2 of a cell it cannot see says so a hundred times: Eq. (1) takes it for a hundred witnesses."""
    total, mean = OccupancyMap(SPEC), LookMap(SPEC, LEARNED)
    for n in range(100):
        pose = SE2(0.01 * n, 0.0, 0.02 * n)
        total.integrate(said(0.2)[0], pose)
        mean.integrate(said(0.2), pose)
    assert total.window(0, 0, 1, 1)[0, 0] == 3.5
    assert mean.window(0, 0, 1, 1)[0, 0] == pytest.approx(0.2, abs=1e-4)


def test_the_geometric_layer_is_a_sum_within_its_clamp() -> None:
    for added, times, expected in ((1.7, 1, 1.7), (1.7, 9, 3.5), (-1.7, 9, -3.5)):
        occupancy = LookMap(SPEC, LEARNED)
        for _ in range(times):
            occupancy.integrate(said(0.0, geometric=added), IDENTITY)
        assert occupancy.window_of_layers(0, 0, 1, 1)[3, 0, 0] == pytest.approx(expected)


def test_the_network_may_doubt_what_was_measured_but_not_deny_it() -> None:
    """From nearly -0.5 for a single hit, up to -0.3 where geometry is sure; its own word where that is more, and beside the hit."""
    assert 1 / (1 + math.exp(-told(-9.0, geometric=0.41))) == pytest.approx(0.383, abs=1e-3)
    assert told(-9.0, geometric=1.75) == pytest.approx(-0.4)
    assert told(-9.0, geometric=1.75, times=4) == pytest.approx(-0.3)
    assert told(-0.2, geometric=0.5) == pytest.approx(-0.2)
    assert told(4.0, geometric=0.5) == pytest.approx(4.0)
    assert told(-9.0, geometric=0.39) == told(-9.0, geometric=1e-3) == -1.5  # a trace: not surely free
    assert told(-1.0, geometric=0.39) == told(-1.0)
    assert told(-9.0, geometric=-1.0) == told(-9.0)  # free or nothing: as the network has it


def test_a_cell_is_surely_free_after_several_looks_only() -> None:
    """As if one look of -1.5 had been there before the car; what reads more than that is not touched."""
    for looks, weight in ((1, 1.0), (3, 1.0), (3, 0.6), (10, 0.9)):
        expected = (-5.0 * looks * weight - 1.5) / (looks * weight + 1)
        assert told(-5.0, weight, times=looks * UPDATES) == pytest.approx(expected, rel=1e-5)
        assert told(-1.45, weight, times=looks * UPDATES) == pytest.approx(-1.45, rel=1e-5)
    assert told(-5.0, times=20 * UPDATES) < -4.75


def test_what_is_known_is_never_0_and_what_is_not_always_is() -> None:
    cancels = Calibration(1.0, 1.0)
    assert 0 < told(-1.0, of=cancels) < 1e-30
    assert 0 < told(-1.0, geometric=2.0, of=cancels) < 1e-30
    assert told(5.0, weight=KNOWN - 0.01) == 0  # hardly held for observable
    assert told(5.0, weight=KNOWN + 0.01) == pytest.approx(5.0, rel=1e-5)
    assert told(0.0, weight=0.0, geometric=1.0, of=cancels) == 1.0  # geometry alone
    assert told(0.0, weight=0.0, of=cancels) == 0
    assert LookMap(SPEC, cancels).window(0, 0, 4, 4).tolist() == [[0.0] * 4] * 4
    assert LookMap(SPEC, cancels).whole()[2].shape == (0, 0)


def test_the_rest_of_the_layers_follow_a_turn() -> None:
    """A post ahead that geometry and network both know is to the left after a left turn, in both layers."""
    occupancy = LookMap(SPEC, LEARNED)
    planes = said(-1.0)
    planes[0, 4:6, 8:10] = planes[2, 4:6, 8:10] = 2.0  # x in [0.75, 1.25)
    occupancy.integrate(planes, SE2(0.0, 0.0, math.pi / 2))
    for layer in occupancy.window_of_layers(-8, -8, 16, 16)[[0, 3]]:
        rows, columns = np.nonzero(layer > 0.25)
        assert ((rows - 8 + 0.5) * SPEC.cell).mean() == pytest.approx(1.0, abs=0.01)
        assert ((columns - 8 + 0.5) * SPEC.cell).mean() == pytest.approx(0.0, abs=0.01)


def test_a_cell_keeps_its_place_across_tile_borders_and_tiles_left_behind_are_forgotten() -> None:
    occupancy = LookMap(SPEC, LEARNED, max_tiles=16)
    planes = said(0.0, weight=0.0)
    planes[:2, 7, 2] = 1.0  # x in [-0.75, -0.5), y in [0.5, 0.75) in base
    side = SIDE * SPEC.cell
    for tile in range(-2, 40):
        occupancy.integrate(planes, SE2(tile * side, -tile * side, 0.0))
        row, column = round((0.5 - tile * side) / SPEC.cell), round((-0.75 + tile * side) / SPEC.cell)
        assert occupancy.window(row, column, 1, 1)[0, 0] == 1.0
    assert len(occupancy.tiles) == 16
    assert occupancy.forgotten > 20
    assert occupancy.window(round(0.5 / SPEC.cell), round(-0.75 / SPEC.cell), 1, 1)[0, 0] == 0
