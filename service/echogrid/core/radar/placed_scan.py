"""A scan with where the car was when it was measured, where its detections lie, and how their range rates fit the car's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise, deviation


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScan:
    """Detections at any distance, moving ones too; `scan` and `deviation` are of those within the mount's range alone."""

    whole: RadarScan
    mount: Mount
    ego: EgoState  # at the time of measurement
    points: Floats  # (N, 2) m, in the sensor's frame
    sigmas: Floats  # (N,) of the range rates from a standing thing's
    near: NDArray[np.bool_]  # (N,) within the mount's range
    scan: RadarScan
    deviation: Floats

    @staticmethod
    def of(scan: RadarScan, mount: Mount, ego: EgoState, noise: GateNoise) -> PlacedScan:
        """A whole scan."""
        points = np.empty((len(scan), 2))
        np.multiply(scan.range, np.cos(scan.azimuth), out=points[:, 0])
        np.multiply(scan.range, np.sin(scan.azimuth), out=points[:, 1])
        sigmas = deviation(scan.azimuth, scan.range_rate, scan.ambiguity, mount, ego.speed, ego.yaw_rate, noise)
        near = scan.range <= mount.max_range
        return PlacedScan(scan, mount, ego, points, sigmas, near, scan.chosen(near), sigmas[near])
