"""What wheels, gyro and mounts can be off by: which errors there are, how large they may be, and what else disturbs.

True speed = (1 + SCALE) x that of the wheels; true yaw rate = (1 + TURN_SCALE) x the gyro's - BIAS; the right rear wheel is faster than the
left one by TRACK x true yaw rate + UNEVEN x speed; radars see the motion that wheels and gyro show DELAY later. Of each radar: the true yaw
of its mount is the configured one + YAW; a true azimuth is (1 + STRETCH) x the measured one; its range rates are RATE too high.
docs/motion.md says where the figures come from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from echogrid.core.messages import Floats

X, Y, HEADING = range(3)  # errors of the pose: true - reckoned, m and rad in odom
POSE = 3
SCALE, BIAS, TURN_SCALE, TRACK, UNEVEN, DELAY = range(POSE, POSE + 6)  # share, rad/s, share, m, share, s
CAR = 6
YAW, STRETCH, RATE = range(3)  # after a radar's place: rad, share, m/s
RADAR = 3

USUAL_TRACK = 1.55  # m
_CAR = (0.01, math.radians(0.4), 0.006, 0.08, 0.01, 0.05)  # one sigma of a car that nothing is known of
_RADAR = (math.radians(1.5), 0.02, 0.05)
_MOST = 3.0  # of these sigmas: as little may become known of an error, and no less
_CAR_WALK = (2e-4, math.radians(0.005), 0.0, 0.0, 2e-5, 0.0)  # how far they wander, per square root of a second
_RADAR_WALK = (math.radians(0.03), 5e-4, 0.005)
_CAR_REST = (0.002, math.radians(0.1), 0.0, 0.0, 5e-4, 0.01)  # and between two drives
_RADAR_REST = (math.radians(0.1), 0.0, 0.01)

# What is no error that stays: heading per square root of a second and of a radian, way along and sideways per square root of a metre.
HEADING_NOISE, TURN_NOISE = math.radians(0.05), math.radians(0.3)
ALONG_NOISE, SIDE_NOISE = 0.01, 0.01
WHEEL_NOISE, GYRO_NOISE = 0.03, 0.003  # m/s, rad/s: of one sample
STANDING_NOISE = math.radians(0.03)  # rad/s: of the gyro's mean over a second of standing still
CREEPING, CREPT = 0.02, 0.3  # rad/s from which on wheels at 0 do not stand but creep; m per square root of a second of it
DIFFERENCE_NOISE, DIFFERENCE_DELAY = 0.004, 0.03  # of the wheels' difference: m/s over a window; s by which wheels and gyro are apart


def places(radars: Sequence[str]) -> dict[str, int]:
    """Where each radar's errors begin."""
    return {name: POSE + CAR + RADAR * n for n, name in enumerate(radars)}


def prior(radars: int) -> tuple[Floats, Floats]:
    """Mean (E,) and covariance (E, E) of a car that nothing is known of, at a known pose."""
    mean = np.zeros(POSE + CAR + RADAR * radars)
    mean[TRACK] = USUAL_TRACK
    return mean, _diagonal(_CAR, _RADAR, radars)


def wandering(radars: int) -> Floats:
    """(E, E) by which the covariance grows in a second."""
    return _diagonal(_CAR_WALK, _RADAR_WALK, radars)


def resting(radars: int) -> Floats:
    """(E, E) by which it grows between two drives."""
    return _diagonal(_CAR_REST, _RADAR_REST, radars)


def most(radars: int) -> Floats:
    """(E,) the largest variances of what is not the pose's, which has no bound."""
    variances = _MOST**2 * _diagonal(_CAR, _RADAR, radars).diagonal()
    return np.where(variances > 0.0, variances, math.inf)


def _diagonal(car: Sequence[float], radar: Sequence[float], radars: int) -> Floats:
    return np.diag(np.square([0.0] * POSE + [*car] + [*radar] * radars))
