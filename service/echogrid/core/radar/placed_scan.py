"""A scan with where the car was when it was measured, and how its range rates fit that."""

from __future__ import annotations

from dataclasses import dataclass

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.radar.mount import Mount


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScan:
    """`scan` holds the detections within the mount's range, moving ones too."""

    scan: RadarScan
    mount: Mount
    ego: EgoState  # at the time of measurement
    deviation: Floats  # (N,) of the range rates from a standing thing's, in sigmas
    whole: RadarScan  # the same scan with what lies beyond that range
