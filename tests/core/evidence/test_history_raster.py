"""The twelve planes against loops over cells, detections, rays and scans, and left against right."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from msgspec.structs import replace

from echogrid.core.evidence.history import Detections, Looks, Surroundings
from echogrid.core.evidence.history_raster import CHANNELS, MOST_RAYS, HistoryRaster
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.kernels.cells import byte_of_rcs
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount

SMALL = GridSpec(cells=16, cell=0.5)
FOV, RANGE = math.radians(70), 5.0
MOUNTS = {
    "front_left": Mount(SE2(1.7, 0.6, math.radians(45)), FOV, RANGE),
    "front_right": Mount(SE2(1.7, -0.6, math.radians(-45)), FOV, RANGE),
    "rear_left": Mount(SE2(-0.6, 0.6, math.radians(135)), FOV, RANGE),
    "rear_right": Mount(SE2(-0.6, -0.6, math.radians(-135)), FOV, RANGE),
}
OTHER_SIDE = {"front_left": "front_right", "front_right": "front_left", "rear_left": "rear_right", "rear_right": "rear_left"}
NOTHING = Detections(np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty(0))


def drawn(seed: int, reach: float, past: int = 60, scans: int = 9) -> Surroundings:
    """Detections, some of them in one cell, within and beyond the patch; a third without a cross-section; the newest update last."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1.2 * reach, 1.2 * reach, (past, 2))
    points[: past // 3] = points[past // 3 : 2 * (past // 3)] + rng.normal(0, 0.05, (past // 3, 2))
    update = np.sort(rng.integers(20, 28, past))
    rcs = np.where(rng.uniform(size=past) < 0.3, np.nan, rng.uniform(-45, 45, past))
    everything = Detections(points, rng.uniform(-2, 2, (past, 2)), rcs, np.abs(rng.normal(0, 2, past)))
    way = np.array([15.0, 9.5, 6.0, 4.9, 2.0, 1.5, 0.7, 0.0])
    place = np.column_stack((rng.uniform(-3, 3, (scans, 2)), rng.uniform(-7, 7, scans)))
    looks = Looks(place, rng.uniform(0.3, 2.8, scans), rng.uniform(2.0, 9.0, scans))
    live = [name for name in MOUNTS if rng.uniform() < 0.7]
    return Surroundings(everything.taken(np.flatnonzero(update == 27)), everything, way[update - 20], update, looks, live)


def byte(count: int) -> int:
    """255 for 255 and more, in equal steps of the logarithm of count + 1."""
    return round(255 * math.log(min(count, 255) + 1) / math.log(256))


def strength(rcs: float) -> int:
    return 0 if math.isnan(rcs) else min(max(round(128 + 4 * rcs), 1), 255)


def slowly(around: Surroundings, spec: GridSpec, mounts: dict[str, Mount]) -> np.ndarray:
    """Cell by cell, from what the channels are said to be."""
    planes = np.zeros((len(CHANNELS), spec.cells, spec.cells), dtype=int)
    now, past = around.now, around.past

    def cell_of(point: np.ndarray, size: float = spec.cell) -> tuple[int, int]:
        return math.floor((point[1] + spec.half) / size), math.floor((point[0] + spec.half) / size)

    for i in range(spec.cells):
        for j in range(spec.cells):
            here = [n for n in range(len(now)) if cell_of(now.points[n]) == (i, j)]
            then = [n for n in range(len(past)) if cell_of(past.points[n]) == (i, j)]
            planes[0, i, j] = byte(len(here))
            planes[1, i, j] = max((strength(now.rcs[n]) for n in here), default=0)
            planes[2, i, j] = max((min(max(int(255 - 60 * now.deviation[n]), 1), 255) for n in here), default=0)
            for plane, window in ((3, 1.5), (4, 5.0), (5, 15.0)):
                planes[plane, i, j] = byte(sum(around.age[n] <= window for n in then))
            planes[6, i, j] = byte(len({around.update[n] for n in then}))
            planes[7, i, j] = max((min(max(int(255 - 254 * around.age[n] / 15), 1), 255) for n in then), default=0)
            planes[8, i, j] = max((strength(past.rcs[n]) for n in then), default=0)
            block = ((np.array((j // 4, i // 4)) + 0.5) * 4 * spec.cell) - spec.half
            planes[10, i, j] = byte(
                sum(
                    in_view(block, tuple(place), fov, reach)
                    for place, fov, reach in zip(around.looks.place, around.looks.half_fov, around.looks.max_range, strict=True)
                )
            )
            centre = (np.array((j, i)) + 0.5) * spec.cell - spec.half
            seen_from = [
                math.hypot(centre[0] - mount.base_from_sensor.x, centre[1] - mount.base_from_sensor.y)
                for mount in (mounts[name] for name in around.live)
                if in_view(
                    centre,
                    (mount.base_from_sensor.x, mount.base_from_sensor.y, mount.base_from_sensor.yaw),
                    mount.half_fov,
                    mount.max_range,
                )
            ]
            planes[11, i, j] = max(int(255 - 8 * min(seen_from)), 1) if seen_from else 0
    rays = [n for n in range(len(past)) if around.age[n] <= 5.0][-MOST_RAYS:]
    passed = dict.fromkeys(np.ndindex(spec.cells // 2, spec.cells // 2), 0)
    for n in rays:
        way = past.points[n] - past.origins[n]
        length, along = math.hypot(*way), spec.cell
        while along < length - 2 * spec.cell:
            block_of = cell_of(past.origins[n] + way * (along / length), 2 * spec.cell)
            if block_of in passed:
                passed[block_of] += 1
            along += 2 * spec.cell
    for i, j in np.ndindex(spec.cells, spec.cells):
        planes[9, i, j] = byte(passed[i // 2, j // 2])
    return planes


def in_view(point: np.ndarray, place: tuple[float, ...], half_fov: float, reach: float) -> bool:
    x, y, yaw = place
    bearing = math.remainder(math.atan2(point[1] - y, point[0] - x) - yaw, 2 * math.pi)
    return math.hypot(point[0] - x, point[1] - y) <= reach and abs(bearing) <= half_fov


@pytest.mark.parametrize("seed", range(6))
def test_every_plane_is_that_of_the_loops(seed: int) -> None:
    around = drawn(seed, SMALL.half)
    found, expected = HistoryRaster(SMALL, MOUNTS)(around), slowly(around, SMALL, MOUNTS)
    for name, one, other in zip(CHANNELS, found, expected, strict=True):
        np.testing.assert_array_equal(one, other, err_msg=name)
        assert one.any(), f"the example says nothing about {name}"


def test_of_more_rays_than_fit_a_cycle_the_newest_count() -> None:
    """The oldest 200 of 1700 detections of the last 5 m would clear the cells ahead; they are left out, and their dots are not."""
    around = drawn(1, SMALL.half)
    ahead, behind = np.tile((3.3, 0.2), (200, 1)), np.tile((-3.3, 0.2), (MOST_RAYS, 1))
    points = np.concatenate((ahead, behind))
    past = Detections(points, np.zeros_like(points), np.zeros(len(points)), np.zeros(len(points)))
    around = replace(around, past=past, age=np.zeros(len(points)), update=np.zeros(len(points), dtype=np.int64))
    planes = dict(zip(CHANNELS, HistoryRaster(SMALL, MOUNTS)(around), strict=True))
    assert planes["passes_5m"][8, 10] == 0
    assert planes["passes_5m"][8, 5] == 255
    assert planes["count_5m"][8, 14] == byte(200)


@pytest.mark.parametrize("seed", range(3))
def test_left_for_right_is_an_exact_mirror(seed: int) -> None:
    """The augmentation of training rests on it: a mirrored world and car draw the mirrored planes, byte for byte."""
    spec = GridSpec()
    around = drawn(seed, spec.half, past=400, scans=30)

    def other_side(of: Detections) -> Detections:
        return replace(of, points=of.points * (1, -1), origins=of.origins * (1, -1))

    mirrored = replace(
        around,
        now=other_side(around.now),
        past=other_side(around.past),
        looks=replace(around.looks, place=around.looks.place * (1, -1, -1)),
        live=[OTHER_SIDE[name] for name in around.live],
    )
    raster = HistoryRaster(spec, {name: dataclasses.replace(mount, max_range=21.0) for name, mount in MOUNTS.items()})
    for name, one, other in zip(CHANNELS, raster(around), raster(mirrored), strict=True):
        np.testing.assert_array_equal(one[::-1], other, err_msg=name)
        assert (one[::-1] != one).any()


def test_nothing_seen_draws_nothing_and_only_bytes() -> None:
    nothing = Surroundings(NOTHING, NOTHING, np.empty(0), np.empty(0, dtype=np.int64), Looks.of([], []), ())
    for around, any_at_all in ((nothing, False), (drawn(2, SMALL.half), True)):
        image = HistoryRaster(SMALL, MOUNTS)(around)
        assert image.dtype == np.uint8
        assert image.shape == (12, 16, 16)
        assert image.any() == any_at_all
        assert image.flags.c_contiguous


def test_view_is_that_of_the_radars_that_are_heard() -> None:
    """Remembered for each set of radars: a radar that falls silent and comes back changes the plane and changes it back."""
    raster, around = HistoryRaster(SMALL, MOUNTS), drawn(3, SMALL.half)
    everyone, three = list(MOUNTS), [name for name in MOUNTS if name != "front_left"]
    before, without, after = (raster(replace(around, live=live))[11] for live in (everyone, three, everyone[::-1]))
    np.testing.assert_array_equal(before, after)
    assert (without <= before).all()
    assert without[15, 15] == 0 < before[15, 15]  # ahead on the left
    assert not raster(replace(around, live=()))[11].any()


def test_cross_sections_as_bytes() -> None:
    """A quarter of a dB a step, none apart from the weakest."""
    assert byte_of_rcs(np.array([np.nan, -60.0, -31.75, 0.0, 0.25, 31.75, 60.0])).tolist() == [0, 1, 1, 128, 129, 255, 255]


def test_a_detection_without_a_cross_section_is_still_a_detection() -> None:
    points = np.array([(1.1, 1.1), (1.1, 1.1), (-1.1, 1.1)])
    found = Detections(points, np.zeros_like(points), np.array([np.nan, -10.0, np.nan]), np.zeros(3))
    around = Surroundings(found, found, np.zeros(3), np.zeros(3, dtype=np.int64), Looks.of([], []), ())
    planes = dict(zip(CHANNELS, HistoryRaster(SMALL, MOUNTS)(around), strict=True))
    for count, rcs in (("now", "now_rcs"), ("count_15m", "rcs_15m")):
        assert (planes[count][10, 10], planes[rcs][10, 10]) == (byte(2), 88)
        assert (planes[count][10, 5], planes[rcs][10, 5]) == (byte(1), 0)
