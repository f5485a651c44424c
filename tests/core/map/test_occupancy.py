"""The tiled map against one plain array, and Eq. (1) against adding by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.footprint import Footprint
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import SIDE
from echogrid.core.map.tiled_map import probability
from echogrid.core.motion.se2 import IDENTITY, SE2

SPEC = GridSpec(cells=32, cell=0.25)
SMALL = GridSpec(cells=10, cell=0.25)


def reference(patches: list[tuple[np.ndarray, SE2]], clamp: float, size: int) -> np.ndarray:
    """Cell by cell: every map cell asks every patch at its centre, bilinearly, and adds. Cells from -size/2 on, both axes."""
    total = np.zeros((size, size))
    for patch, pose in patches:
        base_from_odom = pose.inverse()
        for i in range(size):
            for j in range(size):
                x, y = ((j - size / 2 + 0.5) * SMALL.cell, (i - size / 2 + 0.5) * SMALL.cell)
                px, py = base_from_odom.apply(np.array([[x, y]]))[0]
                u, v = (px + SMALL.half) / SMALL.cell - 0.5, (py + SMALL.half) / SMALL.cell - 0.5
                added = 0.0
                for row, column in ((math.floor(v) + a, math.floor(u) + b) for a in (0, 1) for b in (0, 1)):
                    if 0 <= row < SMALL.cells and 0 <= column < SMALL.cells:
                        added += patch[row, column] * (1 - abs(v - row)) * (1 - abs(u - column))
                total[i, j] = np.clip(total[i, j] + added, -clamp, clamp)
    return total


@settings(max_examples=20)
@given(st.lists(st.builds(SE2, st.floats(-2, 2), st.floats(-2, 2), st.floats(-7, 7)), min_size=1, max_size=3), st.integers(0, 1000))
def test_equal_to_adding_cell_by_cell(poses: list[SE2], seed: int) -> None:
    random = np.random.default_rng(seed)
    patches = [(random.normal(size=(10, 10)).astype(np.float32), pose) for pose in poses]
    occupancy = OccupancyMap(SMALL, clamp=2.0)
    for patch, pose in patches:
        occupancy.integrate(patch, pose)
    size = 40
    np.testing.assert_allclose(occupancy.window(-size // 2, -size // 2, size, size), reference(patches, 2.0, size), atol=1e-4)


def test_probabilities_multiply_as_odds() -> None:
    """Eq. (1): two independent looks of p = 0.8 and 0.7 make odds of 4 * 7/3."""
    patch = np.zeros((32, 32), dtype=np.float32)
    occupancy = OccupancyMap(SPEC)
    for p in (0.8, 0.7):
        patch[16, 16] = math.log(p / (1 - p))
        occupancy.integrate(patch, IDENTITY)
    odds = 4 * 7 / 3
    assert probability(occupancy.window(0, 0, 1, 1))[0, 0] == pytest.approx(odds / (1 + odds), abs=1e-5)


def test_a_cell_keeps_its_place_across_tile_borders() -> None:
    occupancy = OccupancyMap(SPEC)
    patch = np.zeros((32, 32), dtype=np.float32)
    patch[20, 10] = 1.0  # x in [-1.5, -1.25), y in [1, 1.25) in base
    side = SIDE * SPEC.cell
    for tile_x in (-2, -1, 0, 1, 2):
        occupancy.integrate(patch, SE2(tile_x * side, -tile_x * side, 0.0))
        row, column = round((1.0 - tile_x * side) / SPEC.cell), round((-1.5 + tile_x * side) / SPEC.cell)
        assert occupancy.window(row, column, 1, 1)[0, 0] == 1.0
    assert np.count_nonzero(occupancy.whole()[2]) == 5


def test_a_left_turn_carries_what_is_ahead_to_the_left() -> None:
    occupancy = OccupancyMap(SPEC)
    patch = np.zeros((32, 32), dtype=np.float32)
    patch[15:17, 26:28] = 1.0  # ahead, about x = 2.75
    occupancy.integrate(patch, SE2(0.0, 0.0, math.pi / 2))
    row, column, log_odds = occupancy.whole()
    rows, columns = np.nonzero(log_odds > 0.5)
    assert (rows + row).min() * SPEC.cell >= 2.4
    assert abs((columns + column + 0.5).mean() * SPEC.cell) < 0.01


def test_evidence_that_cancels_is_still_seen() -> None:
    occupancy = OccupancyMap(SPEC)
    patch = np.zeros((32, 32), dtype=np.float32)
    for value in (0.5, -0.5):
        patch[16, 16] = value
        occupancy.integrate(patch, IDENTITY)
    assert 0 < occupancy.window(0, 0, 1, 1)[0, 0] < 1e-30


def test_an_empty_map_has_no_cells() -> None:
    assert OccupancyMap(SPEC).whole()[2].shape == (0, 0)


def test_layers_are_resampled_as_if_each_were_alone() -> None:
    planes = np.random.default_rng(2).normal(size=(3, 10, 10)).astype(np.float32)
    pose = SE2(0.7, -1.3, 0.4)
    footprint = Footprint.of(pose, SMALL)
    for plane, alone in zip(footprint.bilinear(planes), planes, strict=True):
        occupancy = OccupancyMap(SMALL, clamp=100.0)
        occupancy.integrate(alone, pose)
        np.testing.assert_array_equal(occupancy.window(footprint.row, footprint.column, *plane.shape), plane)


def test_every_update_is_taken() -> None:
    assert all(OccupancyMap(SPEC).takes(IDENTITY) for _ in range(5))


@given(st.builds(SE2, st.floats(-20, 20), st.floats(-20, 20), st.floats(-7, 7)))
def test_a_footprint_holds_the_patch_and_hardly_more(pose: SE2) -> None:
    """What is beyond costs time, and tiles that nothing is known of."""
    footprint = Footprint.of(pose, SMALL)
    edge = SMALL.half + SMALL.cell / 2
    corners = pose.apply(np.array([(x, y) for x in (-edge, edge) for y in (-edge, edge)])) / SMALL.cell
    for (least, most), first, count in zip(
        np.stack((corners.min(axis=0), corners.max(axis=0)), axis=1), (footprint.column, footprint.row), footprint.shape[::-1], strict=True
    ):
        assert first <= least + 1e-9 < first + 1 + 2e-9
        assert most - 1e-9 <= first + count < most + 3
