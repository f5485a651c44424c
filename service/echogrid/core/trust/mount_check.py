"""Whether a radar that is at odds with ego motion would fit it if it were mounted another way."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from echogrid.core.messages import RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise, deviation

STEP_DEG = 7.5  # of the yaws that are tried; the gate forgives half of that


class OtherMount(NamedTuple):
    """`share` of the detections that stand still if the radar's yaw is `yaw_deg`, and its azimuth's sign reversed where `mirrored`."""

    share: float
    yaw_deg: float
    mirrored: bool


def other_mount(scan: RadarScan, mount: Mount, ego: EgoState, noise: GateNoise) -> OtherMount:
    """The best of all mounts at the same place. What moves fits none: its range rates do not rise and fall with the car's own speed."""
    place = mount.base_from_sensor
    tried = []
    for mirrored in (False, True):
        azimuth = -scan.azimuth if mirrored else scan.azimuth
        for yaw_deg in np.arange(-180.0, 180.0, STEP_DEG).tolist():
            turned = replace(mount, base_from_sensor=SE2(place.x, place.y, math.radians(yaw_deg)))
            sigmas = deviation(azimuth, scan.range_rate, scan.ambiguity, turned, ego.speed, ego.yaw_rate, noise)
            tried.append(OtherMount(float(np.mean(sigmas <= noise.sigmas)), yaw_deg, mirrored))
    return max(tried, key=lambda one: one.share)
