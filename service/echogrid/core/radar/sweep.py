"""All scans of a cycle together, detections in one array: where they lie, and how their range rates fit the car's motion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import compress
from operator import attrgetter

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise, gate_row

_stamp_ns = attrgetter("stamp_ns")


class Sweep(msgspec.Struct, frozen=True, eq=False):
    """Detections of scans (S), at any distance, moving ones too, scan by scan."""

    placed: Sequence[PlacedScan]
    sizes: NDArray[np.int64]  # (S,) detections of each
    scan: NDArray[np.int64]  # (N,) each one's, by its number
    range: Floats  # (N,) m
    azimuth: tuple[Floats, Floats]  # (N,) its cosine and sine
    bearing: tuple[Floats, Floats]  # (N,) in base: cosine and sine
    range_rate: Floats  # (N,) m/s
    rcs: Floats  # (N,) dBsm
    sigmas: Floats  # (N,) of the range rates from a standing thing's
    near: NDArray[np.bool_]  # (N,) within the mount's range
    newest: EgoState  # of the newest scan

    @staticmethod
    def of(placed: Sequence[PlacedScan], noise: GateNoise) -> Sweep:
        """At least one scan."""
        scans = [one.scan for one in placed]
        sizes = [len(scan) for scan in scans]
        count, counts = sum(sizes), np.array(sizes)
        columns, scan, near, sigmas = np.empty((5, count)), np.empty(count, np.int64), np.empty(count, np.bool_), np.empty(count)
        loops.gathered(
            [one.range for one in scans],
            [one.azimuth for one in scans],
            [one.range_rate for one in scans],
            [one.rcs for one in scans],
            np.array([(one.mount.base_from_sensor.yaw, one.mount.max_range) for one in placed]),
            columns,
            scan,
            near,
        )
        _, _, ranges, rate, rcs = columns
        (cos, cos_base), (sin, sin_base) = np.cos(columns[:2]), np.sin(columns[:2])
        rows = np.array([gate_row(one.mount, one.ego.speed, one.ego.yaw_rate, one.scan.ambiguity, noise) for one in placed])
        loops.deviations(cos_base, sin_base, rate, counts, rows, noise.range_rate, noise.azimuth, noise.speed, sigmas)
        newest = max([one.ego for one in placed], key=_stamp_ns)
        return Sweep(placed, counts, scan, ranges, (cos, sin), (cos_base, sin_base), rate, rcs, sigmas, near, newest)

    def only(self, which: Sequence[bool], noise: GateNoise) -> Sweep:
        """Of some of the scans, at least one."""
        return self if all(which) else Sweep.of(list(compress(self.placed, which)), noise)

    def stands(self, sigmas: float) -> NDArray[np.bool_]:
        """(N,) what is near, and at most so many sigmas off a standing thing."""
        return (self.sigmas <= sigmas) & self.near

    def agreeing(self, sigmas: float) -> tuple[list[int], list[int]]:
        """(S,) each: how many of a scan's detections are near, and how many of them at most so many sigmas off a standing thing."""
        found = np.empty((2, len(self.placed)), np.int64)
        loops.agreeing(self.sizes, self.near, self.sigmas, sigmas, found)
        near, standing = found.tolist()
        return near, standing

    def points(self, sensors: Iterable[tuple[float, float, float]]) -> Floats:
        """(N, 2) m, in the frame in which the scans' sensors (S) are at x, y (m) and yaw (rad)."""
        places = np.array([(x, y, math.cos(yaw), math.sin(yaw)) for x, y, yaw in sensors])
        found = np.empty((len(self.range), 2))
        loops.polar(self.range, *self.azimuth, self.sizes, places, found)
        return found
