"""Merged tiles against a dictionary of cells asked one at a time, and identities of sums."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import MOST_LOOKS, MOST_MEASURED
from echogrid.core.map.merge import Placement, Source, merge_tile, placement, touched
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import SIDE, Tile
from echogrid.core.motion.se2 import IDENTITY, SE2

CELL = 0.25
TINY = np.finfo(np.float32).tiny
LAYERS = {"sum": 1, "looks": 5}
Tiles = dict[tuple[int, int], Tile]


def random_map(kind: str, seed: int, places: Sequence[tuple[int, int]] = ((0, 0), (0, 1), (-1, 0))) -> Tiles:
    """Some 300 cells a tile, in no order that a merge could hide behind; values well within the limits."""
    rng = np.random.default_rng(seed)
    tiles = {}
    for place in places:
        some = rng.uniform(size=(SIDE, SIDE)) < 0.02
        layers = np.where(some, rng.normal(0, 0.5, (LAYERS[kind], SIDE, SIDE)), 0).astype(np.float32)
        if kind == "looks":
            layers[1] = np.where(some, rng.uniform(0.25, 5, some.shape), 0)
            layers[2:] = np.where(some, rng.integers(0, 9, (3, *some.shape)), 0)
            layers[2:, rng.uniform(size=some.shape) < 0.5] = 0
        seen = some | (rng.uniform(size=some.shape) < 0.02)
        seen_s = np.where(seen, rng.integers(1, 2**32, some.shape), 0).astype(np.uint32)
        radars = np.where(seen, rng.integers(1, 8, some.shape), 0).astype(np.uint16)
        tiles[place] = Tile(layers, seen_s, radars)
    return tiles


def source(tiles: Tiles, merged_from_map: SE2 = IDENTITY, bits: tuple[int, ...] = (0, 1, 2)) -> Source:
    return Source(tiles.get, placement(merged_from_map, CELL), bits)


def merged(sources: Sequence[tuple[Tiles, Source]], kind: str, clamp: float = 3.5) -> Tiles:
    """All tiles: those that are touched."""
    places = {place for tiles, one in sources for tile in tiles for place in touched(tile, one.placement)}
    found = {place: merge_tile(place, [one for _, one in sources], kind, clamp) for place in sorted(places)}
    return {place: tile for place, tile in found.items() if tile is not None}


def the_same(one: Tiles, other: Tiles) -> bool:
    return one.keys() == other.keys() and all(
        getattr(one[place], name).tobytes() == getattr(other[place], name).tobytes()
        for place in one
        for name in ("layers", "seen_s", "radars")
    )


def cells(tiles: Tiles) -> dict[tuple[int, int], tuple[list[float], int, int]]:
    """Every cell that has something: layers, seen_s, radars."""
    found = {}
    for (tile_row, tile_column), tile in tiles.items():
        for i, j in zip(*np.nonzero(tile.layers.any(axis=0) | (tile.seen_s > 0)), strict=True):
            values = [float(value) for value in tile.layers[:, i, j]]
            found[tile_row * SIDE + int(i), tile_column * SIDE + int(j)] = (values, int(tile.seen_s[i, j]), int(tile.radars[i, j]))
    return found


def reference(
    sources: Sequence[tuple[Tiles, SE2, dict[int, int]]], kind: str, clamp: float
) -> Callable[[int, int], tuple[list[float], int, int]]:
    """One cell of the merged map: every map is asked for the four cells around its centre."""
    known = [(cells(tiles), pose.inverse(), bits) for tiles, pose, bits in sources]

    def at(row: int, column: int) -> tuple[list[float], int, int]:
        total, newest, by, voices = [0.0] * LAYERS[kind], 0, 0, 0
        for of, map_from_merged, bits in known:
            x, y = map_from_merged.apply(np.array([[(column + 0.5) * CELL, (row + 0.5) * CELL]]))[0]
            u, v = x / CELL - 0.5, y / CELL - 0.5
            if map_from_merged.yaw == 0:
                u, v = round(u, 6), round(v, 6)
            mine = [0.0] * LAYERS[kind]
            for i, j in ((math.floor(v) + a, math.floor(u) + b) for a in (0, 1) for b in (0, 1)):
                share = (1 - abs(v - i)) * (1 - abs(u - j))
                if share > 0 and (i, j) in of:
                    values, seen_s, radars = of[i, j]
                    mine = [m + share * value for m, value in zip(mine, values, strict=True)]
                    newest = max(newest, seen_s)
                    for old, new in bits.items():
                        by |= (radars >> old & 1) << new
            voices += any(mine)
            total = [t + m for t, m in zip(total, mine, strict=True)]
        if voices > 1:
            if kind == "sum":
                total[0] = min(max(total[0], -clamp), clamp)
            else:
                total[:2] = [t * min(1.0, MOST_LOOKS / max(total[1], 1.0)) for t in total[:2]]
                total[2:] = [t * min(1.0, MOST_MEASURED / max(total[2] + total[4], 1.0)) for t in total[2:]]
        return total, newest, by

    return at


@pytest.mark.parametrize("kind", ["sum", "looks"])
@pytest.mark.parametrize(
    "pose", [IDENTITY, SE2(-2.5, 40.25, 0.0), SE2(1.1, -0.33, 0.0), SE2(-7.3, 12.9, 0.4), SE2(0.0, 0.0, math.pi / 2), SE2(60.0, -3.0, -2.5)]
)
def test_equal_to_asking_every_map_for_every_cell(kind: str, pose: SE2) -> None:
    one, two = random_map(kind, 1), random_map(kind, 2)
    bits = (3, 0, 1)
    found = merged([(one, source(one)), (two, source(two, pose, bits))], kind, clamp=0.6)
    at = reference([(one, IDENTITY, {0: 0, 1: 1, 2: 2}), (two, pose, dict(enumerate(bits)))], kind, 0.6)
    rng = np.random.default_rng(4)
    asked = 0
    ours = cells(found)
    theirs = {pose_cell(pose, row, column) for row, column in cells(two)} | set(cells(one))
    for row, column in list(ours)[:: max(1, len(ours) // 1000)] + sorted(theirs)[::10] + rng.integers(-300, 400, (200, 2)).tolist():
        values, newest, by = at(row, column)
        mine = ours.get((row, column), ([0.0] * LAYERS[kind], 0, 0))
        assert mine[0] == pytest.approx(values, abs=2e-6)
        assert mine[1:] == (newest, by)
        asked += any(values)
    assert asked > 500


def pose_cell(pose: SE2, row: int, column: int) -> tuple[int, int]:
    x, y = pose.apply(np.array([[(column + 0.5) * CELL, (row + 0.5) * CELL]]))[0]
    return math.floor(y / CELL), math.floor(x / CELL)


@pytest.mark.parametrize("kind", ["sum", "looks"])
def test_alone_or_with_an_empty_map_a_map_stays_as_it_is(kind: str) -> None:
    """Also what lies beyond the limits by a rounding; moved by whole cells and back again too."""
    tiles = random_map(kind, 1)
    tiles[0, 0].layers[:, 5, 5] = [3.5000002] if kind == "sum" else [70.0, 20.000002, 30.0, 50.0, 30.000004]
    empty: Tiles = {}
    blank = {(0, 0): Tile(*(np.zeros_like(array) for array in (tiles[0, 0].layers, tiles[0, 0].seen_s, tiles[0, 0].radars)))}
    assert the_same(merged([(tiles, source(tiles))], kind), tiles)
    assert the_same(merged([(empty, source(empty)), (tiles, source(tiles)), (blank, source(blank, SE2(3, 3, 3)))], kind), tiles)
    there = merged([(tiles, source(tiles, SE2(-3.25, 200.0, 0.0)))], kind)
    assert len(there) > len(tiles)
    back = merged([(there, source(there, SE2(3.25, -200.0, 0.0)))], kind)
    assert the_same({place: tile for place, tile in back.items() if tile.seen_s.any()}, tiles)


@pytest.mark.parametrize("kind", ["sum", "looks"])
def test_a_map_with_itself_is_twice_the_sums(kind: str) -> None:
    tiles = random_map(kind, 7)
    found = merged([(tiles, source(tiles)), (tiles, source(tiles))], kind, clamp=100.0)
    assert found.keys() == tiles.keys()
    for place, tile in found.items():
        np.testing.assert_array_equal(tile.layers, 2 * tiles[place].layers)
        np.testing.assert_array_equal(tile.seen_s, tiles[place].seen_s)
        np.testing.assert_array_equal(tile.radars, tiles[place].radars)


def test_the_order_of_maps_is_no_matter_but_for_the_last_digit() -> None:
    maps = [random_map("looks", seed) for seed in range(4)]
    poses = [IDENTITY, SE2(1, 2, 0.3), SE2(0.5, 0, 0), SE2(-4.2, 1, -2)]
    sources = [(tiles, source(tiles, pose)) for tiles, pose in zip(maps, poses, strict=True)]
    one, two = merged(sources, "looks"), merged([sources[n] for n in (0, 3, 1, 2)], "looks")
    assert one.keys() == two.keys()
    for place, tile in one.items():
        np.testing.assert_allclose(tile.layers, two[place].layers, rtol=1.3e-7)
        np.testing.assert_array_equal(tile.seen_s, two[place].seen_s)
        np.testing.assert_array_equal(tile.radars, two[place].radars)


def test_the_limits_are_those_of_integrating() -> None:
    """Five maps with 6 looks of one another's place: as many as the forgetting leaves, with the same mean and the same share of hits."""
    tiles = {(0, 0): Tile(np.zeros((5, SIDE, SIDE), np.float32), np.zeros((SIDE, SIDE), np.uint32), np.zeros((SIDE, SIDE), np.uint16))}
    tiles[0, 0].layers[:, 3, 4] = (9.0, 6.0, 4.0, 8.0, 16.0)
    found = merged([(tiles, source(tiles))] * 5, "looks")[0, 0].layers[:, 3, 4]
    assert found.tolist() == pytest.approx([30.0, MOST_LOOKS, 12.0, 24.0, 48.0])


def test_evidence_that_cancels_is_still_seen() -> None:
    kind = "sum"
    one, two = random_map(kind, 1), random_map(kind, 1)
    for tile in two.values():
        tile.layers[-1] *= -1
    found = merged([(one, source(one)), (two, source(two))], kind)
    assert found.keys() == one.keys()
    for place, tile in found.items():
        assert ((tile.layers[-1] == TINY) == (one[place].layers[-1] != 0)).all()


def test_two_halves_of_a_drive_make_the_drive() -> None:
    """Eq. (1) is a sum: integrated apart and merged, or into one map, up to the clamp, which is out of the way here."""
    rng = np.random.default_rng(5)
    spec = GridSpec(cells=32, cell=CELL)
    whole, halves = OccupancyMap(spec, clamp=1e3), [OccupancyMap(spec, clamp=1e3) for _ in range(2)]
    for step in range(40):
        patch, pose = rng.normal(size=(32, 32)).astype(np.float32), SE2(0.9 * step, 0.2 * step, 0.1 * step)
        for occupancy in (whole, halves[step // 20]):
            occupancy.integrate(patch, pose)
    found = merged([(half.tiles, source(half.tiles)) for half in halves], "sum", clamp=1e3)
    assert found.keys() == whole.tiles.keys()
    for place, tile in found.items():
        np.testing.assert_allclose(tile.layers, whole.tiles[place].layers, atol=2e-6)
        np.testing.assert_array_equal(tile.layers != 0, whole.tiles[place].layers != 0)


def test_a_placement_is_whole_where_cells_come_onto_cells() -> None:
    assert placement(SE2(0.75, -2.5, 0.0), CELL).whole_cells == (-10, 3)
    assert placement(SE2(0.1 + 0.2, 0.0, 0.0), 0.1).whole_cells == (0, 3)
    assert placement(SE2(0.76, 0.0, 0.0), CELL).whole_cells is None
    assert placement(SE2(0.75, 0.0, 1e-9), CELL).whole_cells is None
    assert Placement(-1.0, 0.0, 0.0, 0.0).whole_cells is None
