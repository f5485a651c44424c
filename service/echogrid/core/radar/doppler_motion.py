"""How the car moves as its radars alone see it: the speed and yaw rate that explain the range rates of most detections."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.radar.mount import Mount

TOLERANCE = 0.4  # m/s: three sigmas of a range rate
LEAST = 8  # detections: fewer explain themselves
PAIRS = np.random.default_rng(0).random((64, 2))  # which two detections each guess is made from, as shares of their number
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
    if sum(len(scan) for scan, _ in scans) < LEAST:
        return None
    slope = np.concatenate([_slope(scan.azimuth, mount) for scan, mount in scans])  # (N, 2)
    rate = np.concatenate([scan.range_rate for scan, _ in scans])  # (N,)
    interval = np.concatenate([np.full(len(scan), scan.ambiguity) for scan, _ in scans])  # (N,)
    pairs = (PAIRS * len(rate)).astype(np.intp)
    pairs = pairs[np.abs(np.linalg.det(slope[pairs])) > APART]
    if not len(pairs):
        return None
    guesses = np.linalg.solve(slope[pairs], rate[pairs][..., None])[..., 0]  # (guesses, 2)
    agreeing = np.abs(_residual(slope, rate, interval, guesses)) < TOLERANCE  # (guesses, N)
    best = int(agreeing.sum(axis=1).argmax())
    chosen = agreeing[best]
    left = _residual(slope, rate, interval, guesses[[best]])[0]
    refined = guesses[best] + np.linalg.lstsq(slope[chosen], left[chosen], rcond=None)[0]
    explained = np.abs(_residual(slope, rate, interval, refined[None]))[0] < TOLERANCE
    bearing = np.concatenate([scan.azimuth + mount.base_from_sensor.yaw for scan, mount in scans])[explained]
    breadth = 1.0 - float(np.abs(np.exp(1j * bearing).mean())) if len(bearing) else 0.0
    return DopplerMotion(float(refined[0]), float(refined[1]), (np.count_nonzero(explained) - 2) / (len(rate) - 2), breadth)


def _slope(azimuth: Floats, mount: Mount) -> Floats:
    """(N, 2) derivatives of a standing point's range rate by speed and yaw rate."""
    sensor = mount.base_from_sensor
    cos, sin = np.cos(azimuth + sensor.yaw), np.sin(azimuth + sensor.yaw)
    return np.stack((-cos, sensor.y * cos - sensor.x * sin), axis=1)


def _residual(slope: Floats, rate: Floats, interval: Floats, motions: Floats) -> Floats:
    """(M, N) what motions (M, 2) leave of the range rates, modulo the Doppler ambiguity interval where there is one."""
    residual: Floats = rate - motions @ slope.T
    known = np.where(interval > 0, interval, 1.0)
    return np.where(interval > 0, residual - known * np.round(residual / known), residual)
