"""The default network's image: twelve planes of bytes of what was seen now, in the last metres of way, and what could have been seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.history import LENGTH, Looks, Surroundings
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.kernels.dispatch import loops
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
RAY_MARGIN = 2.0  # cells before the detection that its ray says nothing about
CLOSE, MIDDLE = 1.5, 5.0  # m of way that the first counts reach back
TOP = 255  # counts from here on look the same
# The byte of a count: 1 is 32, 3 is 64, 15 is 127, 255 is 255.
COUNT = np.rint(255 * np.log1p(np.arange(TOP + 1)) / np.log1p(TOP)).astype(np.uint8)


class HistoryRaster:
    """Callable: surroundings in base -> (12, cells, cells) bytes, rows and columns as in `GridSpec`, channels as in `CHANNELS`."""

    def __init__(self, spec: GridSpec, mounts: Mapping[str, Mount]) -> None:
        self.spec = spec
        self.mounts = mounts
        self._views: dict[frozenset[str], Bytes] = {}
        coarse = GridSpec(spec.cells // COARSE, spec.cell * COARSE)
        self._blocks = coarse.centres()[0, :, 0].astype(np.float32)  # (side,) m, of a column's or a row's middle

    def __call__(self, around: Surroundings) -> Bytes:
        now, past, spec = around.now, around.past, self.spec
        planes = np.empty((len(CHANNELS), spec.cells, spec.cells), dtype=np.uint8)
        loops.draw_now(now.points, now.rcs, now.deviation, spec.half, spec.cell, COUNT, planes[:3])
        loops.draw_past(
            past.points, around.age, around.update, past.rcs, spec.half, spec.cell, CLOSE, MIDDLE, 254 / LENGTH, COUNT, planes[3:9]
        )
        self._passes(around, planes[9])
        self._looks(around.looks, planes[10])
        planes[11] = self._view(frozenset(around.live))
        return planes

    def _passes(self, around: Surroundings, plane: Bytes) -> None:
        """Counted in blocks, all of a block's cells alike."""
        first = len(around.age) - np.count_nonzero(around.age[-MOST_RAYS:] <= MIDDLE)  # ages fall
        origins, points = around.past.origins[first:], around.past.points[first:]
        way = (points - origins).astype(np.float32)
        step, margin = RAY_STEP * self.spec.cell, RAY_MARGIN * self.spec.cell
        loops.draw_passes(origins.astype(np.float32), way, np.hypot(*way.T), self.spec.half, step, margin, RAY_STEP, COUNT, plane)

    def _looks(self, looks: Looks, plane: Bytes) -> None:
        """Counted by the centres of blocks, all of a block's cells alike."""
        scans = np.empty((len(looks.place), 6), np.float32)
        scans[:, :3], scans[:, 4], scans[:, 5] = looks.place, looks.max_range, looks.half_fov
        np.sin(scans[:, 2], out=scans[:, 3])
        np.cos(scans[:, 2::3], out=scans[:, 2::3])
        loops.draw_looks(scans, self._blocks, COUNT, plane)

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
