"""How the car moves as its radars alone see it: the speed and yaw rate that explain the range rates of most detections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.radar.mount import Mount

TOLERANCE = 0.4  # m/s: three sigmas of a range rate
LEAST = 8  # detections: fewer explain themselves
# Which two detections each guess is made from, as shares of their number: spread evenly by the roots of x^3 = x + 1. (numpy.random would
# take 7 MiB of memory.)
PAIRS = np.arange(1, 65)[:, None] * (0.7548776662466927, 0.5698402909980532) % 1.0
APART = 0.3  # how far a guess's two equations must be from one another, as their determinant


class DopplerMotion(NamedTuple):
    """`support`: share of the detections that it explains, less the two that any guess explains. `breadth`: how far their directions in
    base differ, 1 less the length of their mean unit vector: 0 all in one direction, 0.02 over ±20°, 0.1 over ±45°, 1 all around."""

    speed: float  # m/s of base along x
    yaw_rate: float  # rad/s
    support: float
    breadth: float = 1.0


def doppler_motion(scans: Sequence[tuple[RadarScan, Mount]]) -> DopplerMotion | None:
    """Of many guesses, each from two detections, the one that most agree with, refined by least squares over those.

    A standing point's range rate is linear in both: -cos(b) speed + (y cos(b) - x sin(b)) yaw_rate, for its bearing b in base from a mount
    at (x, y). None for fewer than LEAST detections, or all in one direction.
    """
    sizes = [len(scan) for scan, _ in scans]
    if sum(sizes) < LEAST:
        return None
    sensors = [mount.base_from_sensor for _, mount in scans]
    places = np.array([(sensor.x, sensor.y, sensor.yaw, scan.ambiguity) for sensor, (scan, _) in zip(sensors, scans, strict=True)])
    x, y, yaw, interval = np.ascontiguousarray(np.repeat(places, sizes, axis=0).T)  # (N,) each
    bearing = np.concatenate([scan.azimuth for scan, _ in scans]) + yaw
    cos, sin = np.cos(bearing), np.sin(bearing)
    slope = np.empty((len(bearing), 2))  # derivatives of a standing point's range rate by speed and yaw rate
    slope[:, 0], slope[:, 1] = -cos, y * cos - x * sin
    rate = np.concatenate([scan.range_rate for scan, _ in scans])  # (N,)
    one, other = (PAIRS * len(rate)).astype(np.intp).T
    (a, b), (c, d), p, q = slope[one].T, slope[other].T, rate[one], rate[other]
    determinant = a * d - b * c
    apart = np.abs(determinant) > APART
    if not apart.any():
        return None
    guesses = np.stack((p * d - b * q, a * q - p * c), axis=1)[apart] / determinant[apart, None]  # (guesses, 2), by Cramer's rule
    counts = np.empty(len(guesses), dtype=np.int64)
    loops.agreeing(slope, rate, interval, guesses, TOLERANCE, counts)
    best = guesses[counts.argmax()]
    left = _residual(slope, rate, interval, best)
    chosen = np.abs(left) < TOLERANCE
    refined = best + _least_squares(slope[chosen], left[chosen])
    explained = np.abs(_residual(slope, rate, interval, refined)) < TOLERANCE
    breadth = 1.0 - math.hypot(float(cos[explained].mean()), float(sin[explained].mean())) if explained.any() else 0.0
    return DopplerMotion(float(refined[0]), float(refined[1]), (np.count_nonzero(explained) - 2) / (len(rate) - 2), breadth)


def _least_squares(slope: Floats, left: Floats) -> Floats:
    """(2,): by the normal equations, of detections two of which are APART."""
    x, y = slope.T
    xx, xy, yy = float((x * x).sum()), float((x * y).sum()), float((y * y).sum())
    xr, yr = float((x * left).sum()), float((y * left).sum())
    return np.array((xr * yy - xy * yr, xx * yr - xr * xy)) / (xx * yy - xy * xy)


def _residual(slope: Floats, rate: Floats, interval: Floats, motion: Floats) -> Floats:
    """(N,) what a motion (2,) leaves of the range rates, modulo the Doppler ambiguity interval where there is one."""
    residual: Floats = rate - (motion[0] * slope[:, 0] + motion[1] * slope[:, 1])
    known = np.where(interval > 0, interval, 1.0)
    return np.where(interval > 0, residual - known * np.rint(residual / known), residual)
