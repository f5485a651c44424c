"""A scan with where the car was when it was measured."""

from __future__ import annotations

import msgspec

from echogrid.core.messages import RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.radar.mount import Mount


class PlacedScan(msgspec.Struct, frozen=True, eq=False):
    """Detections at any distance, moving ones too."""

    scan: RadarScan
    mount: Mount
    ego: EgoState  # at the time of measurement
