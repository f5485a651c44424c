"""Rectangles against sets of cells, one by one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.map_delta import NOTHING, STEP, Rectangle, around, changed, key_window
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.motion.se2 import SE2

PLACES = st.integers(-40, 40)
RECTANGLES = st.builds(Rectangle, PLACES, PLACES, st.integers(0, 12), st.integers(0, 12))
POSES = st.builds(SE2, st.floats(-500, 500), st.floats(-500, 500), st.floats(-4, 4))


def cells(rectangle: Rectangle) -> set[tuple[int, int]]:
    row, column, height, width = rectangle
    return {(i, j) for i in range(row, row + height) for j in range(column, column + width)}


@given(RECTANGLES, RECTANGLES)
def test_joined_is_the_smallest_that_holds_both(one: Rectangle, other: Rectangle) -> None:
    both = cells(one) | cells(other)
    joined = one.joined(other)
    assert joined in (one, other) if not both else cells(joined) >= both
    if both:
        rows, columns = zip(*both, strict=True)
        assert (joined.height, joined.width) == (max(rows) - min(rows) + 1, max(columns) - min(columns) + 1)


@given(RECTANGLES, RECTANGLES, st.integers(0, 2**32 - 1))
def test_within_finds_the_same_cells(one: Rectangle, other: Rectangle, seed: int) -> None:
    frame = one.joined(other)
    values = np.random.default_rng(seed).random((frame.height, frame.width))
    part = values[one.within(frame)]
    assert part.shape == ((one.height, one.width) if cells(one) else part.shape)
    for row, column in cells(one):
        assert part[row - one.row, column - one.column] == values[row - frame.row, column - frame.column]


@given(st.integers(1, 9), st.integers(1, 9), st.integers(0, 2**32 - 1), st.integers(0, 3))
def test_changed_holds_all_differences_and_no_border_without(height: int, width: int, seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    before = random.integers(-1, 101, (height, width), dtype=np.int8)
    after = before.copy()
    for _ in range(count):
        after[random.integers(height), random.integers(width)] = random.integers(-1, 101)
    differences = {(int(i), int(j)) for i, j in np.argwhere(before != after)}
    found = changed(before, after)
    if not differences:
        assert found == NOTHING
    else:
        rows, columns = zip(*differences, strict=True)
        assert found == (min(rows), min(columns), max(rows) - min(rows) + 1, max(columns) - min(columns) + 1)


@given(POSES, st.sampled_from((16, 17, 100, 128, 256, 1000)))
def test_the_window_around_the_car_is_the_maps(pose: SE2, size: int) -> None:
    occupancy = OccupancyMap(GridSpec(16, 0.25))
    row, column, log_odds = occupancy.around(pose, size)
    assert around(pose, 0.25, size) == (row, column, *log_odds.shape)


@given(POSES, st.sampled_from((2, 5, 16, 17, 100, 128, 256, 1000)))
def test_a_key_window_is_near_and_moves_in_steps(pose: SE2, size: int) -> None:
    window = around(pose, 0.25, size)
    key = key_window(window)
    step = max(1, min(STEP, size // 4))
    assert (key.height, key.width) == (size, size)
    assert key.row % step == key.column % step == 0
    assert max(abs(key.row - window.row), abs(key.column - window.column)) <= step // 2


@pytest.mark.parametrize("size", [16, 128, 256])
def test_along_a_way_the_key_window_moves_once_a_step(size: int) -> None:
    keys = [key_window(around(SE2(x / 100, 0.3, 0.0), 0.25, size)) for x in range(-5000, 5000)]
    moved = [after.column - before.column for before, after in itertools.pairwise(keys) if before != after]
    assert set(moved) == {min(STEP, size // 4)}
    assert sum(moved) == pytest.approx(100 / 0.25, abs=STEP)
