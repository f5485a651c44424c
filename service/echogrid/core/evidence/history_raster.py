"""The default network's image: twelve planes of bytes of what was seen now, in the last metres of way, and what could have been seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.history import LENGTH, Looks, Surroundings
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.messages import Floats
from echogrid.core.radar.mount import Mount

Bytes = NDArray[np.uint8]

CHANNELS = (
    "now",  # detections of this update's scans
    "now_rcs",  # the strongest of them
    "now_static",  # 255 where the range rate fits a standing thing's exactly, less by 60 a sigma
    "count_1.5m",  # detections of the last 1.5 m of way
    "count_5m",
    "count_15m",
    "updates_15m",  # map updates of the last 15 m that had a detection here
    "recency_15m",  # 255 for a detection of now, 1 for one 15 m ago
    "rcs_15m",  # the strongest of the last 15 m
    "passes_5m",  # rays of the last 5 m that passed on their way to a detection
    "looks_15m",  # scans of the last 15 m that had the cell in view
    "view",  # 255 where a radar that is heard has the cell in view close by, less by 8 a metre; 0 where none has
)
COARSE = 4  # cells along a side of the blocks in which fields of view are counted
RAY_STEP = 2  # cells, along a side of the blocks in which rays are counted, and from one to the next point of a ray
MOST_RAYS = 1500  # the newest: bounds the time of a cycle
SCANS = 16  # counted at once: what is worked on stays in the processor's cache
RAY_MARGIN = 2.0  # cells before the detection that its ray says nothing about
TOP = 255  # counts from here on look the same
COUNT = np.rint(255 * np.log1p(np.arange(TOP + 1)) / np.log1p(TOP)).astype(
    np.uint8
)  # the byte of a count: 1 is 32, 3 is 64, 15 is 127, 255 is 255


def byte_of_rcs(rcs: Floats) -> Bytes:
    """1 at -32 dBsm and below, 255 at 31 and above, 0 where none is reported (NaN)."""
    known = np.where(np.isnan(rcs), -128.0, rcs)
    return np.where(np.isnan(rcs), 0, np.clip(np.rint(128 + 4 * known), 1, 255)).astype(np.uint8)


class HistoryRaster:
    """Callable: surroundings in base -> (12, cells, cells) bytes, rows and columns as in `GridSpec`, channels as in `CHANNELS`."""

    def __init__(self, spec: GridSpec, mounts: Mapping[str, Mount]) -> None:
        self.spec = spec
        self.mounts = mounts
        self._views: dict[frozenset[str], Bytes] = {}
        coarse = GridSpec(spec.cells // COARSE, spec.cell * COARSE)
        self._blocks = coarse.centres()[0, :, 0].astype(np.float32)  # (side,) m, of a column's or a row's middle
        self._ray_spec = GridSpec(spec.cells // RAY_STEP, spec.cell * RAY_STEP)

    def __call__(self, around: Surroundings) -> Bytes:
        now, past = around.now, around.past
        here, then = self.spec.locate(now.points), self.spec.locate(past.points)
        planes = (
            self._count(here),
            self._largest(here, byte_of_rcs(now.rcs)),
            self._largest(here, np.clip(255 - 60 * now.deviation, 1, 255).astype(np.uint8)),
            self._count(then[around.age <= 1.5]),
            self._count(then[around.age <= 5.0]),
            self._count(then),
            self._count(self._once(then, around.update)),
            self._largest(then, np.clip(255 - around.age * (254 / LENGTH), 1, 255).astype(np.uint8)),
            self._largest(then, byte_of_rcs(past.rcs)),
            self._passes(past.origins[around.age <= 5.0][-MOST_RAYS:], past.points[around.age <= 5.0][-MOST_RAYS:]),
            self._looks(around.looks),
            self._view(frozenset(around.live)),
        )
        return np.stack(planes)

    def _count(self, cells: NDArray[np.int64]) -> Bytes:
        """How many of the flat cells (N,) are each cell; -1 is none."""
        counts = np.bincount(cells[cells >= 0], minlength=self.spec.cells**2)
        plane: Bytes = COUNT[np.minimum(counts, TOP)]
        return plane.reshape(self.spec.cells, self.spec.cells)

    def _largest(self, cells: NDArray[np.int64], values: Bytes) -> Bytes:
        """The largest value in each cell, 0 where there is none."""
        plane = np.zeros(self.spec.cells**2, dtype=np.uint8)
        order = np.argsort(values, kind="stable")
        order = order[cells[order] >= 0]
        plane[cells[order]] = values[order]  # of several, numpy keeps the last
        return plane.reshape(self.spec.cells, self.spec.cells)

    def _once(self, cells: NDArray[np.int64], update: NDArray[np.int64]) -> NDArray[np.int64]:
        """Each cell at most once an update."""
        size = self.spec.cells**2
        inside = cells >= 0
        return np.unique(update[inside] * size + cells[inside]) % size

    def _passes(self, origins: Floats, points: Floats) -> Bytes:
        """Rays (N, 2) -> (N, 2) m counted in the blocks that they pass, all of a block's cells alike."""
        spec, step = self._ray_spec, self._ray_spec.cell
        way = (points - origins).astype(np.float32)
        distance = np.hypot(*way.T)
        along = np.arange(0.5, distance.max(initial=0.0) / step, dtype=np.float32) * np.float32(step)  # (K,) m
        steps = np.searchsorted(along, distance - RAY_MARGIN * self.spec.cell)  # (N,) points of each ray
        which = np.arange(steps.sum()) - np.repeat(np.cumsum(steps) - steps, steps)  # (M,) of its ray's points, for all points
        share = along[which] / np.repeat(np.maximum(distance, np.float32(1e-3)), steps)
        passed = spec.locate(np.repeat(origins.astype(np.float32), steps, axis=0) + share[:, None] * np.repeat(way, steps, axis=0))
        counts = np.bincount(passed[passed >= 0], minlength=spec.cells**2)
        return _spread(COUNT[np.minimum(counts, TOP)].reshape(spec.cells, spec.cells), RAY_STEP)

    def _looks(self, looks: Looks) -> Bytes:
        """How many scans had each block in view: by its centre, all of its cells alike."""
        x, y, yaw = looks.place.astype(np.float32).T[..., None]  # (S, 1) each
        dx, dy = self._blocks - x, self._blocks - y  # (S, side): squares and products are of the rows' and columns' alone
        squares = (dx * dx)[:, None, :], (dy * dy)[:, :, None]
        products = (dx * np.cos(yaw))[:, None, :], (dy * np.sin(yaw))[:, :, None]
        reach = looks.max_range.astype(np.float32)[:, None, None]
        least = np.cos(looks.half_fov.astype(np.float32))[:, None, None]
        count = np.zeros((len(self._blocks), len(self._blocks)), dtype=np.int64)
        for start in range(0, len(x), SCANS):
            some = slice(start, start + SCANS)
            distance = np.sqrt(squares[0][some] + squares[1][some])  # (SCANS, side, side)
            seen = distance <= reach[some]
            seen &= products[0][some] + products[1][some] >= distance * least[some]
            count += seen.view(np.uint8).sum(axis=0, dtype=np.uint8)
        return _spread(COUNT[np.minimum(count, TOP)], COARSE)

    def _view(self, live: frozenset[str]) -> Bytes:
        """By the nearest radar of `live` that has a cell in view; remembered."""
        if live not in self._views:
            centres = self.spec.centres()
            nearest = np.full(centres.shape[:2], np.inf)
            for mount in (self.mounts[name] for name in live):
                distance = np.hypot(centres[..., 0] - mount.base_from_sensor.x, centres[..., 1] - mount.base_from_sensor.y)
                nearest = np.minimum(nearest, np.where(mount.sees(centres), distance, np.inf))
            self._views[live] = np.where(np.isfinite(nearest), np.clip(255 - 8 * np.minimum(nearest, 99), 1, 255), 0).astype(np.uint8)
        return self._views[live]


def _spread(blocks: Bytes, side: int) -> Bytes:
    """(H, W) -> (side H, side W), every value side x side times."""
    return np.repeat(np.repeat(blocks, side, axis=0), side, axis=1)
