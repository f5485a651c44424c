"""What is asked of a map, against slow and obvious ways to ask it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid_training.evaluation.recorded.comparison import compared
from echogrid_training.evaluation.recorded.scores import (
    FREE,
    OCCUPIED,
    Rectangle,
    above,
    at_area,
    at_free_area,
    at_share,
    free_at,
    occupied_at,
    reached,
    say,
    swept_ground,
)

CELL = 30.0 / 128
WHERE = Rectangle(-20, 7, 60, 80, CELL)


def drawn_map(seed: int) -> np.ndarray:
    """A third unknown."""
    rng = np.random.default_rng(seed)
    log_odds = rng.normal(-0.5, 2.0, (WHERE.height, WHERE.width)).astype(np.float32)
    return np.where(rng.uniform(size=log_odds.shape) < 0.33, np.float32(0), log_odds)


def points(seed: int, count: int = 300) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.uniform(size=(count, 2)) * (WHERE.width, WHERE.height) + (WHERE.column, WHERE.row)) * CELL


@pytest.mark.parametrize("threshold", [-2.0, 0.85, 3.0])
def test_rates_and_areas_are_those_of_a_widened_mask(threshold: float) -> None:
    log_odds, left_out = drawn_map(1), points(2)
    swept = np.random.default_rng(3).uniform(size=log_odds.shape) < 0.2
    said = say(log_odds, WHERE, swept, left_out)
    occupied = (log_odds > threshold) & (log_odds != 0)
    widened = binary_dilation(occupied)
    rows, columns = (np.floor(left_out[:, axis] / CELL).astype(int) - first for axis, first in ((1, WHERE.row), (0, WHERE.column)))
    found = occupied_at(said, threshold)
    assert found.covered_m2 == pytest.approx(widened.sum() * CELL**2)
    assert found.covered_share == pytest.approx(widened[log_odds != 0].mean())
    assert found.recall == pytest.approx(widened[rows, columns].mean())
    assert found.swept == pytest.approx(occupied[swept].mean())
    free = (log_odds < -threshold) & (log_odds != 0)
    assert free_at(said, -threshold).free_m2 == pytest.approx(free.sum() * CELL**2)
    assert free_at(said, -threshold).false_free == pytest.approx(free[rows, columns].mean())


def test_nothing_reaches_beyond_the_four_neighbours() -> None:
    log_odds = np.full((5, 5), -np.inf, dtype=np.float32)
    log_odds[2, 3] = 1.0
    assert sorted(zip(*np.nonzero(reached(log_odds) == 1.0), strict=True)) == [(1, 3), (2, 2), (2, 3), (2, 4), (3, 3)]


@pytest.mark.parametrize("count", [0, 1, 5, 9, 10, 99])
def test_thresholds_leave_no_more_above_them(count: int) -> None:
    values = np.array([1, 3, 3, 3, -2, 0, 7, 7, 5, 1], dtype=np.float32)
    fitting = [one for one in (-np.inf, *values) if (values > one).sum() <= count]
    assert above(values, count) == min(fitting)


def test_maps_that_rank_alike_are_equal_at_equal_areas() -> None:
    """A threshold is chosen by area, so any map that says the same in other numbers has the same scores; so has the yardstick itself."""
    log_odds, left_out = drawn_map(4), points(5)
    other = np.where(log_odds == 0, 0, np.tanh(log_odds / 3) * 7 + 9).astype(np.float32)
    nothing = np.zeros(log_odds.shape, dtype=bool)
    yardstick, mine = (say(one, WHERE, nothing, left_out) for one in (log_odds, other))
    expected = compared(yardstick, yardstick, None)
    occupied, free = occupied_at(yardstick, OCCUPIED), free_at(yardstick, FREE)
    for found in (expected, compared(mine, yardstick, None)):
        for one in (found.equal_area, found.equal_share):
            assert (one.covered_m2, one.covered_share, one.recall) == (occupied.covered_m2, occupied.covered_share, occupied.recall)
        assert (found.equal_free_area.free_m2, found.equal_free_area.false_free) == (free.free_m2, free.false_free)
    assert mine.observed.min() > 0  # and yet the free side works
    first = dataclasses.replace(expected, equal_area=occupied_at(yardstick, 2.0), equal_free_area=free_at(yardstick, -2.0))
    tried = compared(yardstick, yardstick, first)
    assert (tried.first_occupied.threshold, tried.first_free.threshold) == (2.0, -2.0)
    assert tried.first_occupied.recall < tried.equal_area.recall


def test_areas_are_never_larger_than_asked_for() -> None:
    said = say(drawn_map(6).round(), WHERE, np.zeros((WHERE.height, WHERE.width), dtype=bool), points(7))  # many equal values
    for cells in (0, 100, 700, 2000, 10**6):
        assert at_area(said, cells * CELL**2).covered_m2 <= cells * CELL**2 + 1e-9
        assert at_free_area(said, cells * CELL**2).free_m2 <= cells * CELL**2 + 1e-9
    for share in (0.0, 0.1, 0.9):
        assert at_share(said, share).covered_share <= share
    assert at_area(said, 10**6).threshold == -math.inf


def test_swept_ground_is_the_outline_along_the_line() -> None:
    """Cell by cell: driven over is a cell with a point of some outline in it, and those within the outline by a cell surely are."""
    driven = [EgoState(0, SE2(0.5 * step, 0.02 * step**2, 0.08 * step), 5.0, 0.0) for step in range(12)]
    where = Rectangle.around(driven, CELL)
    swept = swept_ground(driven, where)
    x, y = np.meshgrid(np.arange(where.width) + where.column + 0.5, np.arange(where.height) + where.row + 0.5)
    places = np.stack((x.reshape(-1), y.reshape(-1)), axis=-1) * CELL
    margins = []
    for ego in driven:
        x, y = ego.odom_from_base.inverse().apply(places).T
        margins.append(np.minimum(np.minimum(x + 0.95, 3.65 - x), 0.9 - np.abs(y)))  # m to the outline's edge, inside positive
    inside = np.max(margins, axis=0).reshape(swept.shape)
    assert swept[inside > 2 * CELL].all()
    assert not swept[inside < 0].any()
    assert swept.any()


def test_a_part_is_cut_around_a_pose_within_the_whole() -> None:
    def cut(x: float, y: float, most: int) -> tuple[int, int, int, int]:
        part = WHERE.cut(EgoState(0, SE2(x * CELL, y * CELL, 0.0), 0.0, 0.0), most)
        return part.row, part.column, part.height, part.width

    assert cut(50.5, 10.5, 20) == (0, 40, 20, 20)
    assert cut(-99.0, 99.0, 20) == (20, 7, 20, 20)  # the whole has rows -20 to 39 and columns 7 to 86
    assert cut(50.5, 10.5, 70) == (-20, 15, 60, 70)
    assert cut(0.0, 0.0, 1000) == (WHERE.row, WHERE.column, WHERE.height, WHERE.width)


def test_a_map_is_read_whole_and_by_another_rule() -> None:
    """Larger than a strip of tiles."""
    spec = GridSpec(32, 0.5)
    rng = np.random.default_rng(8)
    both = LookMap(spec, Calibration(1.2, -0.1))
    for step in range(40):
        said = rng.normal(size=(2, 32, 32)).astype(np.float32)
        said[1] = rng.uniform(size=(32, 32))
        pose = SE2(1.5 * step, 2.0 * step, 0.1 * step)
        both.integrate(said, pose)
    where = Rectangle(-30, -25, 250, 200, 0.5)
    np.testing.assert_array_equal(where.read(both), both.window(-30, -25, 250, 200))
    np.testing.assert_array_equal(where.read(both, both.learned), both.learned(both.window_of_layers(-30, -25, 250, 200)))
