"""The compiled loops against their numpy reference: the same bits, whatever comes in."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.loops import Fenced, taken_shorter

from echogrid.core.kernels import dispatch, reference
from echogrid.core.kernels.answers import exponential
from echogrid.core.kernels.cells import SIDE
from echogrid.core.kernels.reading import logarithm
from echogrid.core.kernels.sweeps import Scan
from echogrid.core.map.tile import tiles_under

compiled: Any = pytest.importorskip("echogrid.core.kernels.compiled", reason="no C compiler was at hand when echogrid was installed")
TABLE = np.random.default_rng(0).integers(0, 256, 256).astype(np.uint8)
Random = np.random.Generator


def points(random: Random, size: int, reach: float, cell: float) -> np.ndarray:
    """(size, 2), within and a little beyond +-reach, many of them on the borders of cells, some repeated."""
    found = random.uniform(-1.2 * reach, 1.2 * reach, (size, 2))
    on_border = random.random((size, 2)) < 0.3
    found[on_border] = np.round(found[on_border] / cell) * cell
    return found[random.integers(0, max(size, 1), size)] if random.random() < 0.3 else found


def single(random: Random, *shape: int) -> np.ndarray:
    """Log-odds and the like, with zeros and values that cancel."""
    return (random.normal(0, 3, shape) * (random.random(shape) < 0.8)).round(random.integers(0, 7)).astype(np.float32)


def rcs(random: Random, size: int) -> np.ndarray:
    return np.where(random.random(size) < 0.3, np.nan, random.uniform(-45, 45, size).round(random.integers(0, 4)))


def moved(random: Random, size: int) -> list[Any]:
    angle = random.uniform(-7, 7)
    return [points(random, size, 50, 0.25), *random.uniform(-99, 99, 2), np.cos(angle), np.sin(angle), np.empty((size, 2))]


def sizes(random: Random, size: int) -> np.ndarray:
    """Of scans, the last without a detection."""
    ends = np.sort(random.integers(0, size + 1, size % 4))
    return np.diff(np.concatenate(((0,), ends, (size, size))))


def scans(random: Random, count: int) -> np.ndarray:
    """Rows as of Scan, with a zero now and then."""
    return random.uniform(-9, 20, (count, len(Scan))) * (random.random((count, len(Scan))) < 0.8)


def placed(random: Random, size: int) -> list[Any]:
    azimuth, of_each = random.uniform(-4, 4, size), sizes(random, size)
    sensors = random.uniform(-9, 9, (len(of_each), 4)), random.uniform(-99, 99, (len(of_each), 3))
    found = random.uniform(0, 80, size), np.cos(azimuth), np.sin(azimuth)
    return [*found, of_each, *sensors, *random.uniform(-9, 9, 3), np.empty((size, 6))]


def sensors(random: Random, size: int) -> list[Any]:
    count = size % 7
    return [scans(random, count), *(random.uniform(-99, 99, 3) * random.integers(0, 2, 3)), np.empty((count, 4)), np.empty((count, 3))]


def recalled(random: Random, size: int) -> list[Any]:
    count, travelled, update = size % 7, random.uniform(0, 99, size), random.integers(0, 1 << 40, size).astype(float)
    kept = points(random, size, 50, 0.25), points(random, size, 50, 0.25), travelled, update, random.uniform(-99, 99, (count, 3))
    written = np.empty((2, size, 2)), np.empty(size), np.empty(size, np.int64), np.empty((count, 3))
    return [*kept, *random.uniform(-99, 99, 4), *written]


def deviations(random: Random, size: int) -> list[Any]:
    bearing, of_each = random.uniform(-4, 4, size), sizes(random, size)
    rate, near, written = random.normal(0, 20, size), random.random(size) < 0.8, (np.empty(size), np.ones((2, len(of_each)), np.int64))
    return [np.cos(bearing), np.sin(bearing), rate, near, of_each, scans(random, len(of_each)), 0.13, 0.03, 0.01, 30.0, *written]


def draw_now(random: Random, size: int) -> list[Any]:
    deviation = np.abs(random.normal(0, 2, size))
    return [points(random, size, 4, 0.5), rcs(random, size), deviation, 4.0, 0.5, TABLE, np.ones((3, 16, 16), np.uint8)]


def draw_past(random: Random, size: int) -> list[Any]:
    update = np.sort(random.integers(-3, 11, size))
    age = 15 - update * 1.5  # down to 0, among them 1.5 and 6
    out = np.ones((6, 16, 16), np.uint8)
    return [points(random, size, 4, 0.5), age, update, rcs(random, size), 4.0, 0.5, 1.5, 6.0, 254 / 15, TABLE, out]


def draw_passes(random: Random, size: int) -> list[Any]:
    origins, ends = (points(random, size, 4, 0.5).astype(np.float32) for _ in range(2))
    way = ends - origins
    return [origins, way, np.hypot(*way.T), 4.0, 1.0, random.choice([0.5, 1.0]), 2, TABLE, np.ones((16, 16), np.uint8)]


def draw_looks(random: Random, size: int) -> list[Any]:
    yaw, half_fov = random.uniform(-7, 7, size), random.uniform(0.2, 3, size)
    x, y = points(random, size, 4, 1.0).T
    reach = random.uniform(0, 9, size).round(random.integers(0, 3))  # some end in the middle of a block
    scans = np.stack((x, y, np.cos(yaw), np.sin(yaw), reach, np.cos(half_fov)), axis=1).astype(np.float32)
    return [scans, (np.arange(4, dtype=np.float32) - 1.5) * 2, TABLE, np.ones((16, 16), np.uint8)]


def footprint(random: Random) -> list[Any]:
    """How a patch of 12 x 12 cells of 0.25 m lies on a rectangle that often goes over the border of tiles."""
    angle = random.choice([0.0, np.pi / 2, random.uniform(-4, 4)])
    row, column = random.choice([-10, SIDE - 10, -3 * SIDE - 17]), random.integers(-SIDE, 3 * SIDE)
    x, y = ((first + 10 + random.choice([0.0, 0.5, random.random()])) * 0.25 for first in (column, row))
    return [int(row), int(column), *random.integers(1, 21, 2).tolist(), 0.25, x, y, np.cos(angle), np.sin(angle), 6.5]


def bilinear(random: Random, size: int) -> list[Any]:
    lies = footprint(random)
    return [single(random, size % 3 + 1, 12, 12), *lies, np.ones((size % 3 + 1, *lies[2:4]), np.float32)]


def tile_layers(random: Random, count: int) -> list[np.ndarray]:
    """Of (5, SIDE, SIDE), few of which are worked out: they are many."""
    return [np.tile(np.abs(single(random, 5, 8, 8)) * 5, (1, SIDE // 8, SIDE // 8)) for _ in range(count)]


def tile_views(random: Random, count: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Radars and seconds of tiles."""
    radars = [np.tile(random.integers(0, 9, (8, 8)), (SIDE // 8, SIDE // 8)).astype(np.uint16) for _ in range(count)]
    return radars, [one.astype(np.uint32) << 28 for one in radars]


def note_views(random: Random, size: int) -> list[Any]:
    lies = footprint(random)
    keys = tiles_under(*lies[:4])
    bits = (random.integers(0, 1 << 16, (12, 12)) * random.integers(0, 2, (12, 12))).astype(np.uint16)
    return [bits, *lies, int(random.integers(0, 1 << 32)), np.array(keys), *tile_views(random, len(keys))]


def add_looks(random: Random, size: int) -> list[Any]:
    lies, weight = footprint(random), np.abs(single(random, 12, 12))
    keys = tiles_under(*lies[:4])
    answer, cap = np.stack((single(random, 12, 12), weight)), float(random.choice([1.2, 20.0]))
    return [answer, 0.25, *lies, cap, np.array(keys), tile_layers(random, len(keys))]


def add_clamped(random: Random, size: int) -> list[Any]:
    layer = single(random, size, 5)
    return [np.float32(random.choice([-1, 1])) * layer[::-1].copy() if size % 2 else -layer, 3.5, 1e-38, layer]


def elfes(random: Random, size: int) -> list[Any]:
    origins, ends = points(random, size, 2, 0.25), points(random, size, 2, 0.25)
    angles = np.arctan2(*(ends - origins).T[::-1])[:, None] + np.linspace(-0.1, 0.1, 5)
    rays, shares = np.stack((np.cos(angles), np.sin(angles)), axis=-1), random.dirichlet(np.ones(5))
    distance = np.hypot(*(ends - origins).T)
    return [origins, distance, rays, shares, 2.0, 0.25, -0.12, 1.7, random.choice([0.0, 0.5]), np.ones((16, 16), np.float32)]


def look(random: Random, size: int, side: int = 60) -> list[Any]:
    row, column, rays = int(random.integers(-200, 200)), int(random.integers(-200, 200)), 5
    middle = np.array((column + side / 2, row + side / 2)) * 0.25
    origins, ends = points(random, size, 2, 0.25) + middle, points(random, size, 8, 0.25) + middle
    away = ends - origins
    distance, bearing = np.hypot(*away.T), np.arctan2(away[:, 1], away[:, 0])[:, None] + random.normal(0, 0.1, (size, rays))
    hit, marks = random.choice([0.0, 0.3, 0.9], side**2).astype(np.float32), random.integers(0, 8, side**2).astype(np.uint8)
    tiles = np.prod([(first + side - 1) // SIDE - first // SIDE + 1 for first in (row, column)])
    dtypes = (np.int32, np.float32, np.float32, np.float32, np.uint16)
    return [
        *(
            row,
            column,
            side,
            0.25,
            np.cos(bearing),
            np.sin(bearing),
            random.dirichlet(np.ones(rays)),
        ),
        *(ends, origins, distance, (1 << random.integers(0, 4, size)).astype(np.uint16)),
        *(0.5, np.array([-side, -1, 0, 2, side + 1]), np.array([1.0, 1.7, 2.7, 0.9, 0.4]), hit, marks),
        np.zeros(side**2, np.uint32),
        np.empty((side**2, 32), np.uint8),
        *(np.empty(tiles + 1, np.int64), *(np.zeros(side**2, dtype) for dtype in dtypes)),
    ]


def add_measured(random: Random, size: int) -> list[Any]:
    count = size % 3 + 1
    begins = np.sort(np.append(random.integers(0, size + 1, count - 1), (0, size)))
    near = np.append(np.arange(60), SIDE * SIDE - 1 - np.arange(60))  # the tile's first cell and its last
    cells = np.concatenate([random.permutation(near)[:some] for some in np.diff(begins)]).astype(np.int32)
    flags, who = random.random((2, size)) < 0.2, random.integers(0, 4, size).astype(np.uint16)
    more, tiles = np.abs(single(random, 3, size)), (tile_layers(random, count), *tile_views(random, count))
    return [begins, cells, *more, *flags, who, 1_700_000_000, 10.0, float(random.choice([1.2, 60.0])), *tiles]


def usual(random: Random, size: int) -> list[Any]:
    here, beside = np.array([-1, 0, 1]), np.arange(-20, 21)
    means = np.abs(single(random, 2, 2, 400)) / 9
    hit = np.unique(random.integers(0, 400, size))
    return [
        *(hit, here, beside, 0.07, random.random(), 0.2, 0.25, 0.2, 0.02, bool(random.random() < 0.8), *means),
        *np.ones((2, 400), np.bool_),
    ]


def fold(random: Random, size: int) -> list[Any]:
    height, width = size % 7 + 1, size % 5 + 1
    return [random.integers(0, 256, (3, 2 * height, 2 * width)).astype(np.uint8), np.zeros((12, height, width), np.uint8)]


def odds(random: Random, size: int) -> list[Any]:
    return [single(random, 12, size, 6) * np.float32(random.choice([0.1, 1.0, 40.0])), np.ones((2, 2 * size, 12), np.float32)]


def read_out(random: Random, size: int) -> list[Any]:
    """What a map's layers hold, much of it nothing; what they should not hold comes too."""
    layers = np.abs(single(random, 5, size % 7, size + 70)) * np.float32(random.choice([0.1, 1.0, 20.0]))
    layers[0] *= random.choice([-1, 1], layers[0].shape)
    layers[:, :, random.integers(0, size + 1) :] *= random.choice([0, 1])
    strange = random.random(layers.shape) < 0.01
    layers[strange] = random.choice([np.nan, np.inf, -np.inf, 1e-38, -1e30, 1e38], strange.sum())
    rule = np.array([0.372, 2.8, 1.7, 21.0, 2.2, 0.4, 2.8, np.log(1 / 9), 1 / 9, 0.38, 4.0, 2.0, 3.3, 4.2, -2.13, 0.72], np.float32)
    row, column, beyond = random.integers(-9, 9, 3)
    places = np.array([(row - 3, column + 1), (row + size % 7, column), (row + 99, column - 99)])[: random.integers(1, 4)]
    out = np.ones((size % 7 + 2, size + 70 + beyond), np.float32)
    return [int(row), int(column), places, [layers, layers[:, :, 5:], layers][: len(places)], *random.normal(1, 0.3, 2), rule, out]


def percent(random: Random, size: int) -> list[Any]:
    special = np.array([np.nan, np.inf, -np.inf, 1e9, 1e-38, 0.0, -0.0], np.float32)
    return [random.choice(np.concatenate((single(random, 50), special)), (size, 7)), np.zeros((size, 7), np.int8)]


def differing(random: Random, size: int) -> list[Any]:
    """Often equal but for a few places; parts of larger arrays."""
    before = random.integers(-1, 3, (size % 9, size + 5)).astype(np.int8)
    after = before.copy()
    for _ in range(int(random.integers(0, 3)) if before.size else 0):
        after[random.integers(len(after)), random.integers(size + 5)] = 7
    return [before[:, 2 : size + 3], after[:, 2 : size + 3], np.ones(4, np.int64)]


def standing(random: Random, size: int) -> list[Any]:
    """Many are 2 m apart, in a row ahead."""
    azimuth, range_ = random.uniform(-1, 1, size) * random.integers(0, 2), random.uniform(0, 9, size).round(random.integers(0, 3))
    sigmas = np.where(random.random(size) < 0.05, np.nan, np.abs(random.normal(0, 3, size)).round())
    return [range_, np.cos(azimuth), np.sin(azimuth), sizes(random, size), sigmas, 3.0, 2.0, 1.0, np.ones(size, np.bool_)]


def gathered(random: Random, size: int) -> list[Any]:
    of_each = np.asarray(sizes(random, size)).tolist()
    arrays, rows = [random.normal(0, 9, count) for count in of_each for _ in range(4)], scans(random, len(of_each))
    for one, row in zip(arrays[::4], rows, strict=True):
        row[Scan.RANGE] = one[0] if len(one) and random.random() < 0.5 else row[Scan.RANGE]
    return [arrays, rows, np.ones((5, size)), np.ones(size, np.int64), np.ones(size, np.bool_)]


def gated(random: Random, size: int) -> list[Any]:
    """Now and then both times the same are asked for."""
    near, range_ = random.random(size) < 0.7, random.uniform(0, 3, size)
    range_ = range_ if random.random() < 0.7 else np.where(near, 1.0, 3.0)
    sigmas = np.where(random.random(size) < 0.05, np.nan, np.abs(random.normal(0, 3, size)).round())
    written = [np.ones(size, np.uint8), np.zeros((2, size + 1), np.int64)]
    return [points(random, size, 5, 1.0), sigmas, near, range_, 2.0, 3.0, 2.0, *written]


def possible(random: Random, size: int) -> list[Any]:
    return [random.normal(0, 1, size).round(1), random.normal(0, 40, size).round(-1), 1.3, 70.0, np.ones(1, np.int64)]


def leanings(random: Random, size: int) -> list[Any]:
    bearing, spread = random.uniform(-3, 3, size), random.normal(0, 0.1, (7, 7))
    rate, interval = random.normal(-7, 2, size), random.choice([0.0, 0.8, 12.5])
    motion = random.normal(3, 2, 9) * (random.random(9) < 0.9)
    noise = (0.13, 0.03, 0.1, 3.0, 6.0, float(random.choice([1.0, 10.0])), 1.3)
    written = [np.ones((size, 7)), np.ones(size), np.ones(size)]
    return [np.cos(bearing), np.sin(bearing), bearing, rate, *motion, interval, spread @ spread.T, *noise, *written]


def nearby(random: Random, size: int) -> list[Any]:
    """Many are 2 m apart."""
    count = size // 2
    mine, older = points(random, size, 5, 1.0), points(random, count, 5, 1.0)
    radars, of = random.integers(0, 3, size), random.integers(0, 3, count)
    return [mine, random.choice([1.0, 2.0], size), radars, older, of, np.zeros((2, size * count), np.int64), np.ones(1, np.int64)]


def common_motion(random: Random, size: int) -> list[Any]:
    """Most rates fit one motion; now and then all are in one direction, where no guess can be made."""
    sizes, bearing = np.array((size // 3, size - size // 3)), random.uniform(-3, 3, size) * random.choice([0.0, 1.0])
    rows = scans(random, 2)
    rows[:, (Scan.X, Scan.Y, Scan.AMBIGUITY)] = (3.6, 0.8, random.choice([0.0, 16.0])), (-0.8, -0.8, 0.0)
    x, y, interval = np.repeat(rows[:, (Scan.X, Scan.Y, Scan.AMBIGUITY)], sizes, axis=0).T
    rate = (y * np.cos(bearing) - x * np.sin(bearing)) * 0.2 - np.cos(bearing) * 7 + random.normal(0, 3, size) * (random.random(size) < 0.4)
    rate += interval * random.integers(-1, 2, size)
    near = random.random(size) < random.choice([0.0, 0.7, 1.0])
    return [np.cos(bearing), np.sin(bearing), rate, near, sizes, rows, random.random((2, 12)), 0.3, 0.4, np.ones(7)]


def signals(random: Random, size: int) -> list[Any]:
    """Payloads of 12 bytes; signals of up to 64 bits that lie in them, upwards and downwards, some over nine bytes."""
    places = []
    for _ in range(6):
        length, shift = int(random.integers(1, 65)), int(random.integers(0, 8))
        behind = (shift + length - 1) // 8  # bytes
        step = int(random.choice([-1, 1]))
        first = int(random.integers(0, 12 - behind)) + (behind if step < 0 else 0)
        places.append((first, step, shift, length, random.random() < 0.5))
    payloads = random.integers(0, 256, (size, 12)).astype(np.uint8)
    return [
        payloads,
        np.array(places, np.int64),
        random.normal(0, 9, (6, 2)),
        *(np.zeros((size, 6), t) for t in (np.uint64, np.int64, float, np.bool_)),
    ]


def quantities(random: Random, size: int) -> list[Any]:
    """Two of each of three signals in a frame; four flags."""
    physical = random.choice([0.0, -1.5, np.nan, np.inf, 2e9, 3.25], (size, 6))
    raw, there = random.integers(0, 4, (size, 6)), random.random((size, 6)) < 0.8
    flags = np.array([(0, 1, 0, 2), (1, 0, 1, 3), (2, 1, 2, 2), (2, 0, 0, 1)])
    plan = random.integers([0, -1, -1], [3, 4, 4], (4, 3))
    everywhere = int(random.integers(-1, 4))
    return [physical, raw, there, 2, plan, random.normal(size=(4, 2)), flags, np.array([1, 2, 3]), everywhere, 1e9, np.ones((4, 2 * size))]


CASES: dict[str, Callable[[Random, int], list[Any]]] = {
    case.__name__: case
    for case in (
        *(
            moved,
            placed,
            sensors,
            recalled,
            deviations,
            draw_now,
            draw_past,
            draw_passes,
            draw_looks,
            bilinear,
            note_views,
            add_looks,
            add_clamped,
            elfes,
            look,
        ),
        *(add_measured, usual, fold, odds, standing, common_motion, signals, quantities, read_out, percent, differing),
        *(gathered, gated, possible, nearby, leanings),
    )
}


INTAKE = {"identify", "assemble", "can_frames", "join_frames"}  # by test_intake.py
READERS = {"candump_lines", "asc_lines", "trc_lines", "csv_lines", "blf_objects"}  # held to the line readers by tests/logs/test_lines.py


@pytest.mark.parametrize("name", CASES)
@given(seed=st.integers(0, 1 << 32), size=st.integers(0, 80))
def test_the_same_bits_as_numpy(name: str, seed: int, size: int) -> None:
    fenced, expected = Fenced(CASES[name](np.random.default_rng(seed), size)), CASES[name](np.random.default_rng(seed), size)
    found = fenced.arguments
    getattr(compiled, name)(*found)
    assert fenced.is_whole
    with np.errstate(all="ignore"):  # some are given what is no number, or too large
        getattr(reference, name)(*expected)
    if name == "look":
        found, expected = ordered(found), ordered(expected)
    for one, other in zip(found, expected, strict=True):
        for mine, its in zip(one, other, strict=True) if isinstance(one, list) else ((one, other),):
            assert np.asarray(mine).dtype == np.asarray(its).dtype
            np.testing.assert_array_equal(mine, its)


@pytest.mark.parametrize("size", [254, 255, 256, 300])
def test_more_than_a_byte_counts_are_the_table_s_last(size: int) -> None:
    """Of detections in one cell and of rays along one way, each as the table has it."""
    random = np.random.default_rng(size)
    for draw in (draw_now, draw_past, draw_passes):
        found, expected = draw(random, size), draw(random, size)
        for given_ in (found, expected):
            given_[0][:] = 0.1
        if draw is draw_passes:
            found[1:3] = expected[1:3] = np.full((size, 2), np.float32(2.0)), np.full(size, np.float32(np.hypot(2.0, 2.0)))
        else:
            found[1:-1] = expected[1:-1]
        getattr(compiled, draw.__name__)(*found)
        getattr(reference, draw.__name__)(*expected)
        np.testing.assert_array_equal(found[-1], expected[-1])
        assert TABLE[min(size, 255)] in found[-1]


def test_a_look_may_touch_its_whole_window() -> None:
    found, expected = (look(np.random.default_rng(3), 40, side=240) for _ in range(2))
    for given_ in (found, expected):
        given_[12], given_[13] = np.arange(-50000, 50000), np.ones(100000)
    compiled.look(*found)
    reference.look(*expected)
    found, expected = ordered(found), ordered(expected)
    assert found[-6][-1] == 240**2  # the last tile's end
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def ordered(arguments: list[Any]) -> list[Any]:
    """Of a look: cells by their place within each tile, and nothing behind the last; without what its room is left with."""
    *given_, _, begins, inside, hits, near, passes, who = arguments
    cells = slice(begins[-1])
    tile = np.repeat(np.arange(len(begins) - 1), np.diff(begins))
    order = np.lexsort((inside[cells], tile))
    return [*given_, begins, *(values[cells][order] for values in (inside, hits, near, passes, who))]


def test_the_exponential_is_one() -> None:
    x = np.linspace(-60, 60, 100_001).astype(np.float32)
    np.testing.assert_allclose(exponential(x), np.exp(x.astype(float)), rtol=3e-7)


def test_the_logarithm_is_one() -> None:
    x = np.exp(np.linspace(-69, 69, 100_001)).astype(np.float32)
    true = np.log(x.astype(float))
    assert (np.abs(logarithm(x) - true) <= 3e-7 * np.maximum(np.abs(true), 1)).all()
    assert logarithm(np.array([1.0, np.nan, -3.0, 0.0], np.float32)).tolist() == [
        0.0,
        *[float(logarithm(np.array([1e-30], np.float32))[0])] * 3,
    ]


def test_every_loop_is_compared() -> None:
    assert set(CASES) | READERS | INTAKE == {name for name in dir(compiled) if not name.startswith("_")}


@pytest.mark.parametrize(
    ("name", "place", "wrong"),
    [
        ("moved", 0, np.zeros((5, 2), np.float32)),
        ("moved", 0, np.zeros((5, 4))[:, ::2]),
        ("moved", 5, np.zeros((4, 2))),
        ("placed", 3, np.array([3, 3])),
        ("deviations", 4, np.array([6, -1])),
        ("draw_now", 6, np.zeros((3, 16, 8), np.uint8)),
        ("add_measured", 1, np.full(5, SIDE * SIDE, np.int32)),
        ("add_measured", 1, np.full(5, -1, np.int32)),
        *(("add_measured", 0, np.array(begins)) for begins in ([0, 2, 1, 5], [-1, 0, 2, 5], [0, 1, 2, 6])),
        ("add_measured", 11, [np.zeros((4, SIDE, SIDE), np.float32)] * 3),
        ("add_looks", 13, np.zeros((2, 3), np.int64)),
        ("add_looks", 14, [np.zeros((1, SIDE, SIDE), np.float32)] * 9),
        ("note_views", 12, np.zeros((2, 1), np.int64)),
        ("note_views", 13, np.zeros((1, SIDE, SIDE), np.uint16)),
        ("bilinear", 3, 30),
        ("look", 12, np.zeros(7, np.float32)),
        *(("common_motion", 6, np.full((2, 12), share)) for share in (-0.1, 1.0, np.nan)),
    ],
)
def test_arrays_that_do_not_fit_are_refused(name: str, place: int, wrong: np.ndarray) -> None:
    arguments = CASES[name](np.random.default_rng(0), 5)
    arguments[place] = wrong
    with pytest.raises((TypeError, ValueError)):
        getattr(compiled, name)(*arguments)
    with pytest.raises(TypeError):
        getattr(compiled, name)(*arguments[:-1])


# Whose number is free: scans, a last one of nothing; layers that others fill; guesses; cells, steps, neighbours; bytes that no signal has.
MAY_BE_SHORTER = {"draw_looks": {(0, 0)}, "standing": {(3, 0)}, "add_looks": {(14, 0)}, "common_motion": {(6, 1)}}
MAY_BE_SHORTER |= {"usual": {(0, 0), (1, 0), (2, 0)}, "signals": {(0, 1)}, "read_out": {(3, 1), (3, 2), (7, 0), (7, 1)}}


@pytest.mark.parametrize("name", CASES)
def test_an_array_that_is_one_shorter_than_the_others_say_is_refused(name: str) -> None:
    assert taken_shorter(getattr(compiled, name), CASES[name](np.random.default_rng(3), 11)) == MAY_BE_SHORTER.get(name, set())


@pytest.mark.parametrize("wanted", ["", "numpy"])
def test_one_place_decides_which_runs(wanted: str) -> None:
    code = "from echogrid.core.kernels.dispatch import COMPILED, WHY, loops; print(COMPILED, loops.__name__.split('.')[-1], WHY)"
    environment = {**os.environ, "ECHOGRID_KERNELS": wanted}
    said = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
    assert said.startswith("False reference numpy" if wanted else "True compiled compiled")


@pytest.mark.parametrize("built_from", ["compiled._built_from + 1", "None"], ids=["other sources", "a build of before this was told"])
def test_loops_of_other_sources_are_not_taken_and_this_is_said(built_from: str) -> None:
    """What `git pull` without `make` leaves: names that are missing, or arrays that mean something else."""
    code = f"from echogrid.core.kernels import compiled; compiled._built_from = {built_from}; "
    code += "import echogrid.core.kernels.dispatch as d; print(d.COMPILED, d.loops.__name__.split('.')[-1], d.WHY)"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "ECHOGRID_KERNELS": ""}, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("False reference numpy")
    assert all("was built from other sources" in said and "run make" in said for said in (done.stdout, done.stderr))


def test_it_knows_every_source_it_was_built_from() -> None:
    folder = Path(dispatch.__file__).parent
    sources = sorted(path for path in folder.iterdir() if path.suffix in (".c", ".h"))
    assert len(sources) > 1
    assert {path.name for path in sources} >= set(re.findall(r'#include "(.*)"', "".join(path.read_text() for path in sources)))
    assert compiled._built_from == zlib.crc32(b"".join(path.read_bytes() for path in sources))
