"""All scans of a cycle together, detections in one array: where they lie, and how their range rates fit the car's motion."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

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
        columns = [(scan.range, scan.azimuth, scan.range_rate, scan.rcs) for scan in scans]
        ranges, azimuth, rate, rcs = (np.concatenate(column) for column in zip(*columns, strict=True))
        yaw, reach = np.repeat([(one.mount.base_from_sensor.yaw, one.mount.max_range) for one in placed], sizes, axis=0).T
        bearing = azimuth + yaw
        cos, sin = np.cos(bearing), np.sin(bearing)
        rows = np.array([gate_row(one.mount, one.ego.speed, one.ego.yaw_rate, one.scan.ambiguity, noise) for one in placed])
        sigmas = np.empty(len(rate))
        loops.deviations(cos, sin, rate, sizes, rows, noise.range_rate, noise.azimuth, noise.speed, sigmas)
        return Sweep(placed, sizes, ranges, (np.cos(azimuth), np.sin(azimuth)), (cos, sin), rate, rcs, sigmas, ranges <= reach)

    def only(self, which: Sequence[bool], noise: GateNoise) -> Sweep | None:
        """Of some of the scans; None where that are none of them."""
        if all(which):
            return self
        some = [one for one, is_wanted in zip(self.placed, which, strict=True) if is_wanted]
        return Sweep.of(some, noise) if some else None

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

    def of_each(self, values: Any) -> NDArray[Any]:
        """(S, …) of the scans to (N, …) of their detections."""
        return np.repeat(values, self.sizes, axis=0)

    def points(self, sensors: Iterable[tuple[float, float, float]]) -> Floats:
        """(N, 2) m, in the frame in which the scans' sensors (S) are at x, y (m) and yaw (rad)."""
        places = np.array([(x, y, math.cos(yaw), math.sin(yaw)) for x, y, yaw in sensors])
        found = np.empty((len(self.range), 2))
        loops.polar(self.range, *self.azimuth, self.sizes, places, found)
        return found


def _stamp_ns(ego: EgoState) -> int:
    return ego.stamp_ns
