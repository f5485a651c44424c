"""A scan with where the car was when it was measured."""

from __future__ import annotations

from typing import NamedTuple

from echogrid.core.messages import RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.radar.mount import Mount


class PlacedScan(NamedTuple):
    """Detections at any distance, moving ones too."""

    scan: RadarScan
    mount: Mount
    ego: EgoState  # at the time of measurement
