"""How the car moves as its radars alone see it: the speed and yaw rate that explain the range rates of most detections."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
from echogrid.core.radar.sweep import Sweep

TOLERANCE = 0.4  # m/s: three sigmas of a range rate
LEAST = 8  # detections: fewer explain themselves
# Which two detections each guess is made from, as shares of their number: spread evenly by the roots of x^3 = x + 1. (numpy.random would
# take 7 MiB of memory.)
PAIRS = np.array(((0.7548776662466927,), (0.5698402909980532,))) * np.arange(1, 65) % 1.0
APART = 0.3  # how far a guess's two equations must be from one another, as their determinant


class DopplerMotion(NamedTuple):
    """`support`: share of the detections that it explains, less the two that any guess explains. `breadth`: how far their directions in
    base differ, 1 less the length of their mean unit vector: 0 all in one direction, 0.02 over ±20°, 0.1 over ±45°, 1 all around."""

    speed: float  # m/s of base along x
    yaw_rate: float  # rad/s
    support: float
    breadth: float = 1.0


@lru_cache(maxsize=512)
def _pairs(count: int) -> NDArray[np.int64]:
    """(2, P) numbers of so many detections."""
    return (PAIRS * count).astype(np.int64)


def doppler_motion(sweep: Sweep) -> DopplerMotion | None:
    """Of many guesses, each from two detections, the one that most agree with, refined by least squares over those.

    A standing point's range rate is linear in both: -cos(b) speed + (y cos(b) - x sin(b)) yaw_rate, for its bearing b in base from a mount
    at (x, y). Detections beyond the mounts' range do not count. None for fewer than LEAST, or all in one direction.
    """
    sizes, rate, (cos, sin) = sweep.sizes, sweep.range_rate, sweep.bearing
    if not sweep.near.all():
        near = np.flatnonzero(sweep.near)
        sizes, rate, cos, sin = np.array(sweep.agreeing(0.0)[0]), rate.take(near), cos.take(near), sin.take(near)
    if len(rate) < LEAST:
        return None
    sensors = [(one.mount.base_from_sensor, one.scan.ambiguity) for one in sweep.placed]
    places = np.array([(sensor.x, sensor.y, ambiguity) for sensor, ambiguity in sensors])
    one, other = _pairs(len(rate))
    motion, explained = np.empty(3), np.empty(len(rate), dtype=np.bool_)
    loops.common_motion(cos, sin, rate, sizes, places, one, other, APART, TOLERANCE, motion, explained)
    speed, yaw_rate, found = motion.tolist()
    if not found:
        return None
    count, weight = int(np.count_nonzero(explained)), explained.astype(float)
    breadth = 1.0 - math.hypot(float(cos @ weight), float(sin @ weight)) / count if count else 0.0
    return DopplerMotion(speed, yaw_rate, (count - 2) / (len(rate) - 2), breadth)
