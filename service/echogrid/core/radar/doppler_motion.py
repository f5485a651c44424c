"""How the car moves as its radars alone see it: the speed and yaw rate that explain the range rates of most detections."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from echogrid.core.kernels.dispatch import loops
from echogrid.core.radar.sweep import Sweep

TOLERANCE = 0.4  # m/s: three sigmas of a range rate
LEAST = 8  # detections: fewer explain themselves
# Which two detections each guess is made from, as shares of their number: spread evenly by the roots of x^3 = x + 1. (numpy.random would
# take 7 MiB of memory.)
PAIRS = np.outer((0.7548776662466927, 0.5698402909980532), np.arange(1.0, 65.0)) % 1.0
APART = 0.3  # how far a guess's two equations must be from one another, as their determinant


class DopplerMotion(NamedTuple):
    """`support`: share of the detections that it explains, less the two that any guess explains. `breadth`: how far their directions in
    base differ, 1 less the length of their mean unit vector: 0 all in one direction, 0.02 over ±20°, 0.1 over ±45°, 1 all around."""

    speed: float  # m/s of base along x
    yaw_rate: float  # rad/s
    support: float
    breadth: float = 1.0


def doppler_motion(sweep: Sweep) -> DopplerMotion | None:
    """Of many guesses, each from two detections, the one that most agree with, refined by least squares over those.

    A standing point's range rate is linear in both: -cos(b) speed + (y cos(b) - x sin(b)) yaw_rate, for its bearing b in base from a mount
    at (x, y). Detections beyond the mounts' range do not count. None for fewer than LEAST, or all in one direction.
    """
    found = np.empty(7)
    loops.common_motion(*sweep.bearing, sweep.range_rate, sweep.near, sweep.sizes, sweep.scans, PAIRS, APART, TOLERANCE, found)
    speed, yaw_rate, is_found, near, count, cos, sin = found.tolist()
    if near < LEAST or not is_found:
        return None
    breadth = 1.0 - math.hypot(cos, sin) / count if count else 0.0
    return DopplerMotion(speed, yaw_rate, (count - 2) / (near - 2), breadth)
