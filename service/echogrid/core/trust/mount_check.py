"""Whether a radar that is at odds with ego motion would fit it if it were mounted another way."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise, deviation

STEP_DEG = 7.5  # of the yaws that are tried; the gate forgives half of that


class OtherMount(NamedTuple):
    """`share` of the detections that stand still if the radar's yaw is `yaw_deg`; `reversed_share`: as it is, with reversed azimuths."""

    share: float
    yaw_deg: float
    reversed_share: float


def other_mount(scan: RadarScan, mount: Mount, ego: EgoState, noise: GateNoise) -> OtherMount:
    """The best of all yaws at the same place. What moves fits none: its range rates do not rise and fall with the car's own speed.

    One scan cannot tell reversed azimuths from another yaw: reversed at a yaw, it fits as it is at the yaw on the other side of the
    radar's own way. So they are tried at the configured yaw alone, and where they fit both are said.
    """
    place = mount.base_from_sensor

    def standing(azimuth: Floats, yaw: float) -> float:
        turned = replace(mount, base_from_sensor=SE2(place.x, place.y, yaw))
        sigmas = deviation(azimuth, scan.range_rate, scan.ambiguity, turned, ego.speed, ego.yaw_rate, noise)
        return float(np.mean(sigmas <= noise.sigmas))

    shares = {yaw_deg: standing(scan.azimuth, math.radians(yaw_deg)) for yaw_deg in np.arange(-180.0, 180.0, STEP_DEG).tolist()}
    best = max(shares, key=shares.__getitem__)
    return OtherMount(shares[best], best, standing(-scan.azimuth, place.yaw))
