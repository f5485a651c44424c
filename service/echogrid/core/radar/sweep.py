"""All scans of a cycle together, detections in one array: where they lie, and how their range rates fit the car's motion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import compress, pairwise

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise, gate_row


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
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

    @staticmethod
    def of(placed: Sequence[PlacedScan], noise: GateNoise) -> Sweep:
        """At least one scan."""
        scans = [one.scan for one in placed]
        sizes = np.array([len(scan) for scan in scans])
        scan = np.repeat(np.arange(len(scans)), sizes)
        columns = [(one.range, one.azimuth, one.range_rate, one.rcs) for one in scans]
        ranges, azimuth, rate, rcs = (np.concatenate(column) for column in zip(*columns, strict=True))
        yaw, reach = np.array([(one.mount.base_from_sensor.yaw, one.mount.max_range) for one in placed]).T.take(scan, axis=1)
        bearing = azimuth + yaw
        cos, sin = np.cos(bearing), np.sin(bearing)
        rows = np.array([gate_row(one.mount, one.ego.speed, one.ego.yaw_rate, one.scan.ambiguity, noise) for one in placed])
        sigmas = np.empty(len(rate))
        loops.deviations(cos, sin, rate, sizes, rows, noise.range_rate, noise.azimuth, noise.speed, sigmas)
        return Sweep(placed, sizes, scan, ranges, (np.cos(azimuth), np.sin(azimuth)), (cos, sin), rate, rcs, sigmas, ranges <= reach)

    def only(self, which: Sequence[bool], noise: GateNoise) -> Sweep:
        """Of some of the scans, at least one."""
        return self if all(which) else Sweep.of(list(compress(self.placed, which)), noise)

    @property
    def newest(self) -> EgoState:
        """Of the newest scan."""
        return max((one.ego for one in self.placed), key=_stamp_ns)

    def slices(self) -> list[slice]:
        """(S,) where each scan's detections are."""
        ends = self.sizes.cumsum().tolist()
        return [slice(begin, end) for begin, end in pairwise((0, *ends))]

    def stands(self, sigmas: float) -> NDArray[np.bool_]:
        """(N,) what is near, and at most so many sigmas off a standing thing."""
        return (self.sigmas <= sigmas) & self.near

    def counted(self, which: NDArray[np.bool_]) -> list[int]:
        """(S,) how many of a mask (N,) are each scan's."""
        found: list[int] = np.bincount(self.scan[which], minlength=len(self.placed)).tolist()
        return found

    def points(self, sensors: Iterable[tuple[float, float, float]]) -> Floats:
        """(N, 2) m, in the frame in which the scans' sensors (S) are at x, y (m) and yaw (rad)."""
        places = np.array([(x, y, math.cos(yaw), math.sin(yaw)) for x, y, yaw in sensors])
        found = np.empty((len(self.range), 2))
        loops.polar(self.range, *self.azimuth, self.sizes, places, found)
        return found


def _stamp_ns(ego: EgoState) -> int:
    return ego.stamp_ns
