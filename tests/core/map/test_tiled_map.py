"""Tiles that leave the memory and come back, and what a cell knows of who saw it, against slow and obvious references."""

from __future__ import annotations

import math
from collections import OrderedDict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from echogrid.core.evidence.beams import Beams
from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import SIDE, Tile, TileKey, most_tiles_along, tile_bytes
from echogrid.core.map.tiled_map import NEWEST_S, TiledMap, View
from echogrid.core.mapper import in_view
from echogrid.core.motion.se2 import IDENTITY, SE2
from echogrid.core.radar.mount import Mount

SPEC = GridSpec(cells=32, cell=0.25)
SIDE_M = SIDE * SPEC.cell
MOUNTS = {
    "left": Mount(SE2(1.0, 0.5, 0.8), 1.2, 3.0),
    "right": Mount(SE2(1.0, -0.5, -0.8), 1.2, 3.0),
    "rear": Mount(SE2(-1, 0, math.pi), 1.0, 2.5),
}


class Drawer:
    """A shelf that keeps copies, and counts."""

    def __init__(self) -> None:
        self.held: dict[TileKey, Tile] = {}
        self.stores = self.loads = 0
        self.before: list[dict[TileKey, Tile]] = []

    def load(self, key: TileKey) -> Tile | None:
        self.loads += key in self.held
        return self.held[key].copy() if key in self.held else None

    def store(self, key: TileKey, tile: Tile) -> None:
        self.stores += 1
        self.held[key] = tile.copy()

    def keys(self) -> set[TileKey]:
        return set(self.held)

    def clear(self, begun_ns: int) -> None:
        self.before.append(self.held)
        self.held = {}


def made(kind: type[TiledMap], max_tiles: int) -> TiledMap:
    return OccupancyMap(SPEC, max_tiles=max_tiles) if kind is OccupancyMap else LookMap(SPEC, Calibration(1.1, -0.2), max_tiles=max_tiles)


def said(kind: type[TiledMap], rng: np.random.Generator) -> Image:
    planes = rng.normal(size=(2, 32, 32)).astype(np.float32)
    planes[1] = np.abs(planes[1])
    return planes[0] if kind is OccupancyMap else planes


def drive(occupancy: TiledMap, kind: type[TiledMap], seed: int, updates: int = 150) -> None:
    """Back and forth over some tiles, looking at a window now and then."""
    rng = np.random.default_rng(seed)
    x = y = 0.0
    for n in range(updates):
        x, y = x + rng.normal(0, SIDE_M / 2), y + rng.normal(0, SIDE_M / 2)
        x, y = (float(np.clip(place, -2 * SIDE_M, 2 * SIDE_M)) for place in (x, y))
        view = View(10**9 * (100 + n), rng.integers(0, 8, (32, 32)).astype(np.uint16))
        occupancy.integrate(said(kind, rng), SE2(x, y, float(rng.uniform(-4, 4))), view)
        if n % 7 == 0:
            occupancy.around(SE2(*rng.uniform(-2 * SIDE_M, 2 * SIDE_M, 2).tolist(), 0.0), 150)


@pytest.mark.parametrize("kind", [OccupancyMap, LookMap])
@pytest.mark.parametrize("room", [1, 2, 5])
def test_a_map_with_a_shelf_is_bit_for_bit_the_one_with_room_for_all(kind: type[TiledMap], room: int) -> None:
    roomy, small, shelf = made(kind, 4096), made(kind, room), Drawer()
    small.shelf = shelf
    for occupancy in (roomy, small):
        drive(occupancy, kind, seed=3)
    assert len(small.tiles) <= max(room, 4) < 20 <= len(roomy.tiles)  # an update changes up to four together
    assert shelf.loads > 50
    assert small.forgotten == 0
    assert small.bounds() == roomy.bounds()
    everywhere = roomy.bounds()
    assert small.window_of_layers(*everywhere).tobytes() == roomy.window_of_layers(*everywhere).tobytes()
    for one, other in zip(small.window_of_views(*everywhere), roomy.window_of_views(*everywhere), strict=True):
        np.testing.assert_array_equal(one, other)


def test_what_is_dirty_and_what_the_shelf_has_are_together_the_whole_map() -> None:
    """As a keeper sees it: after each update every tile is on the shelf as it is, or known to differ."""
    occupancy, shelf = made(LookMap, 3), Drawer()
    occupancy.shelf = shelf
    rng = np.random.default_rng(1)
    clean = 0
    for n in range(60):
        pose = SE2(float(rng.uniform(-SIDE_M, SIDE_M)), float(rng.uniform(-SIDE_M, SIDE_M)), 0.0)
        occupancy.integrate(said(LookMap, rng), pose, View(n, np.ones((32, 32), np.uint16)))
        assert occupancy.dirty <= occupancy.tiles.keys()
        for key in occupancy.tiles.keys() - occupancy.dirty:
            clean += 1
            assert occupancy.tiles[key].layers.tobytes() == shelf.held[key].layers.tobytes()
        if n % 4 == 0:  # as a keeper does
            for key in occupancy.dirty:
                shelf.held[key] = occupancy.tiles[key].copy()
            occupancy.dirty.clear()
    assert clean > 20


@settings(max_examples=30)
@given(st.integers(1, 6), st.lists(st.tuples(st.booleans(), st.integers(-3, 3), st.integers(-3, 3)), max_size=60))
def test_the_tile_that_was_used_least_recently_goes_first(room: int, uses: list[tuple[bool, int, int]]) -> None:
    """Updates and windows within one tile each, against a list by hand; a window of nothing keeps nothing."""
    occupancy = made(OccupancyMap, room)
    by_hand: OrderedDict[TileKey, None] = OrderedDict()
    forgotten = 0
    patch = np.ones((32, 32), dtype=np.float32)
    for update, row, column in uses:
        key = (row, column)
        if update:
            occupancy.integrate(patch, SE2((column + 0.5) * SIDE_M, (row + 0.5) * SIDE_M, 0.0))
            by_hand[key] = None
        else:
            occupancy.window(row * SIDE + 5, column * SIDE + 7, 20, 30)
        if key in by_hand:
            by_hand.move_to_end(key)
        while len(by_hand) > room:
            by_hand.popitem(last=False)
            forgotten += 1
    assert list(occupancy.tiles) == list(by_hand)
    assert occupancy.forgotten == forgotten


def test_a_map_that_begins_anew_leaves_all_of_the_old_one_on_the_shelf() -> None:
    occupancy, shelf = made(OccupancyMap, 2), Drawer()
    occupancy.shelf = shelf
    for tile in range(5):
        occupancy.integrate(np.full((32, 32), 1.0 + tile, np.float32), SE2((tile + 0.5) * SIDE_M, SIDE_M / 2, 0.0))
    occupancy.clear(0)
    (before,) = shelf.before
    assert {key: tile.layers.max() for key, tile in before.items()} == {(0, tile): min(1.0 + tile, 3.5) for tile in range(5)}
    assert occupancy.bounds() == (0, 0, 0, 0)
    assert not occupancy.window(0, 0, SIDE, 5 * SIDE).any()
    assert occupancy.forgotten == 0


def test_each_cell_knows_when_and_by_whom_it_was_seen() -> None:
    """Against every map cell asking at its own centre, for each update, whose field of view the patch's nearest cell lies in."""
    occupancy = made(LookMap, 4096)
    views = in_view(MOUNTS, SPEC)
    names = list(MOUNTS)
    half, size = SPEC.half, 60
    seen_s, radars = np.zeros((size, size), np.int64), np.zeros((size, size), np.int64)
    rng = np.random.default_rng(5)
    for n in range(9):
        pose = SE2(*rng.uniform(-3, 3, 2).tolist(), float(rng.uniform(-4, 4)))
        there = [name for name in names if rng.uniform() < 0.5]
        bits = np.bitwise_or.reduce([views[name] for name in there] or [np.zeros((32, 32), np.uint16)])
        second = 1_700_000_000 + n // 2
        occupancy.integrate(said(LookMap, rng), pose, View(second * 10**9 + n, bits))
        for i, j in np.ndindex(size, size):
            ((x, y),) = pose.inverse().apply(np.array([((j - 30 + 0.5) * 0.25, (i - 30 + 0.5) * 0.25)]))
            cell = np.array((math.floor((x + half) / 0.25), math.floor((y + half) / 0.25)))
            if ((cell >= 0) & (cell < 32)).all():
                centre = (cell + 0.5) * 0.25 - half
                for name in there:
                    if MOUNTS[name].sees(centre):
                        seen_s[i, j] = second
                        radars[i, j] |= 1 << names.index(name)
    found_s, found_radars = occupancy.window_of_views(-30, -30, size, size)
    assert 0.2 < (radars != 0).mean() < 0.9
    agree = (found_s == seen_s) & (found_radars == radars)
    assert agree.mean() > 0.999  # centres that lie on a border of two cells may go either way in float32
    assert len(np.unique(found_radars)) > 4  # alone, and together


def test_a_view_goes_on_when_the_map_says_nothing_and_the_other_way_round() -> None:
    occupancy = made(OccupancyMap, 16)
    nothing, something = np.zeros((32, 32), np.float32), np.ones((32, 32), np.float32)
    occupancy.integrate(nothing, IDENTITY, View(7 * 10**9, np.full((32, 32), 5, np.uint16)))
    assert [int(found[0, 0]) for found in occupancy.window_of_views(0, 0, 1, 1)] == [7, 5]
    assert occupancy.window(0, 0, 1, 1) == 0
    occupancy.integrate(something, IDENTITY, View(9 * 10**9, np.zeros((32, 32), np.uint16)))
    assert [int(found[0, 0]) for found in occupancy.window_of_views(0, 0, 1, 1)] == [7, 5]
    assert occupancy.window(0, 0, 1, 1) == 1


@pytest.mark.parametrize(("stamp_ns", "seen_s"), [(0, 1), (10**9 - 1, 1), (2 * 10**9, 2), (2**62, min(2**62 // 10**9, NEWEST_S)), (-5, 1)])
def test_times_that_no_clock_shows_are_kept_within_what_a_cell_can_hold(stamp_ns: int, seen_s: int) -> None:
    occupancy = made(OccupancyMap, 16)
    occupancy.integrate(np.zeros((32, 32), np.float32), IDENTITY, View(stamp_ns, np.ones((32, 32), np.uint16)))
    assert occupancy.window_of_views(0, 0, 1, 1)[0] == seen_s


def test_what_geometry_measured_is_told_from_what_is_learned_only() -> None:
    occupancy = made(LookMap, 16)
    occupancy.integrate(np.ones((2, 32, 32), np.float32), IDENTITY)
    occupancy.takes(IDENTITY)
    beams = Beams(np.array([[2.1, 0.1]]), np.array([[0.1, 0.1]]), np.ones(1, np.uint16))
    occupancy.measure(beams, IDENTITY, View(0, np.ones((32, 32), np.uint16)))
    layers = occupancy.window_of_layers(-10, -10, 20, 20)
    assert (occupancy.read(layers) != 0).all()
    measured = occupancy.measured(layers)
    assert measured[10, 10]  # the beam passed
    assert measured[10, 10 + math.floor(2.1 / SPEC.cell)]
    assert not measured[:, :6].any()


@pytest.mark.parametrize("cells", [1, 2, 127, 128, 129, 130, 256, 300])
def test_how_many_tiles_a_row_of_cells_touches(cells: int) -> None:
    assert most_tiles_along(cells) == max((first + cells - 1) // SIDE - first // SIDE + 1 for first in range(-SIDE, SIDE))
    assert tile_bytes(4) == sum(array.nbytes for array in (Tile.empty(4).layers, Tile.empty(4).seen_s, Tile.empty(4).radars))


def test_the_whole_is_what_is_known_to_the_cell() -> None:
    """Two cells, one on each side of the origin; of an empty map nothing, from the origin on."""
    occupancy = OccupancyMap(SPEC)
    assert occupancy.whole()[:2] == (0, 0)
    answer = np.zeros((32, 32), np.float32)
    answer[5, 25], answer[20, 9] = 1.0, -2.0
    occupancy.integrate(answer, IDENTITY)
    row, column, log_odds = occupancy.whole()
    expected = np.zeros((16, 17))
    expected[0, 16], expected[15, 0] = 1.0, -2.0
    assert (row, column) == (5 - 16, 9 - 16)
    np.testing.assert_array_equal(log_odds, expected)
