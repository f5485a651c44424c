"""All scans of a cycle together, detections in one array: where they lie, and how their range rates fit the car's motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import compress
from operator import attrgetter

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise

_stamp_ns = attrgetter("stamp_ns")


class Sweep(msgspec.Struct, frozen=True, eq=False):
    """Detections of scans (S), at any distance, moving ones too, scan by scan."""

    placed: Sequence[PlacedScan]
    scans: Floats  # (S, 12) as kernels.sweeps.Scan has them
    sizes: NDArray[np.int64]  # (S,) detections of each
    scan: NDArray[np.int64]  # (N,) each one's, by its number
    range: Floats  # (N,) m
    azimuth: tuple[Floats, Floats]  # (N,) its cosine and sine
    bearing: tuple[Floats, Floats]  # (N,) in base: cosine and sine
    range_rate: Floats  # (N,) m/s
    rcs: Floats  # (N,) dBsm
    sigmas: Floats  # (N,) of the range rates from a standing thing's
    near: NDArray[np.bool_]  # (N,) within the mount's range
    agreeing: tuple[list[int], list[int]]  # (S,) each: how many of a scan's are near, and how many of these fit the car's motion
    newest: EgoState  # of the newest scan

    @staticmethod
    def of(placed: Sequence[PlacedScan], noise: GateNoise) -> Sweep:
        """At least one scan."""
        arrays = [array for one in placed for array in (one.scan.range, one.scan.azimuth, one.scan.range_rate, one.scan.rcs)]
        sizes = [array.size for array in arrays[::4]]
        count, counts, fitting = sum(sizes), np.array(sizes), np.empty((2, len(sizes)), np.int64)
        columns, scan, near, sigmas = np.empty((5, count)), np.empty(count, np.int64), np.empty(count, np.bool_), np.empty(count)
        scans = np.array([_row(one, noise) for one in placed])
        loops.gathered(arrays, scans, columns, scan, near)
        _, _, ranges, rate, rcs = columns
        (cos, cos_base), (sin, sin_base) = np.cos(columns[:2]), np.sin(columns[:2])
        errors = noise.range_rate, noise.azimuth, noise.speed, noise.sigmas
        loops.deviations(cos_base, sin_base, rate, near, counts, scans, *errors, sigmas, fitting)
        asked, standing = fitting.tolist()
        newest = max([one.ego for one in placed], key=_stamp_ns)
        bearing = cos_base, sin_base
        return Sweep(placed, scans, counts, scan, ranges, (cos, sin), bearing, rate, rcs, sigmas, near, (asked, standing), newest)

    def only(self, which: Sequence[bool], noise: GateNoise) -> Sweep:
        """Of some of the scans, at least one."""
        return self if all(which) else Sweep.of(list(compress(self.placed, which)), noise)

    def stands(self, sigmas: float) -> NDArray[np.bool_]:
        """(N,) what is near, and at most so many sigmas off a standing thing."""
        return (self.sigmas <= sigmas) & self.near

    def sensors(self, odom_from_base: SE2) -> tuple[Floats, Floats]:
        """Where the scans' sensors were: (S, 4) in the base that is there, x, y (m), cosine and sine of their yaw; (S, 3) in odom, x, y and
        yaw."""
        count = len(self.scans)
        in_base, in_odom = np.empty((count, 4)), np.empty((count, 3))
        loops.sensors(self.scans, *odom_from_base, in_base, in_odom)
        return in_base, in_odom

    def placed_at(self, odom_from_base: SE2) -> tuple[Floats, Floats, Floats, Floats]:
        """(N, 2) m each: in the base that is there, in odom, and in odom of the sensors that measured them; and those (S, 3), as `sensors`
        has them."""
        in_base, in_odom = self.sensors(odom_from_base)
        found = np.empty((self.range.size, 6))
        loops.placed(self.range, *self.azimuth, self.sizes, in_base, in_odom, *odom_from_base, found)
        return found[:, :2], found[:, 2:4], found[:, 4:], in_odom

    def standing(self, noise: GateNoise, nearest: float) -> NDArray[np.bool_]:
        """(N,) what stands, scan by scan as the gate sees it, and is more than `nearest` m away."""
        found = np.empty(self.range.size, np.bool_)
        loops.standing(self.range, *self.azimuth, self.sizes, self.sigmas, noise.sigmas, noise.mover_radius, nearest, found)
        return found


def _row(one: PlacedScan, noise: GateNoise) -> tuple[float, ...]:
    """As kernels.sweeps.Scan has it."""
    mount, ego = one.mount, one.ego
    x, y, yaw = mount.base_from_sensor
    turning = math.hypot(x, y) * noise.yaw_rate
    return x, y, yaw, mount.max_range, mount.half_fov, ego.speed, ego.yaw_rate, one.scan.ambiguity, turning, *ego.odom_from_base
