"""How each radar itself moved, scan by scan, from its range rates alone: neither mount nor ego motion goes into it.

A standing thing at azimuth a shows the range rate -(vx cos a + vy sin a) to a sensor that moves with (vx, vy) in its own frame. Most
detections stand: the velocity that most of a scan agree with is the sensor's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from echogrid.core.messages import Floats
from echogrid.judging.recorded import Flags, RadarTrack

LEAST = 6  # detections that must agree
SHARE = 0.4  # of a scan's detections that must agree
PAIRS = np.random.default_rng(0).random((24, 2))  # which two detections each guess is made from, as shares of their number
APART = 0.15  # sine of the angle between the two
TOLERANCE, TOLERANCE_SHARE = 0.25, 0.03  # m/s, and of the velocity: what still agrees
WRAPPED = 1 / 8  # of the Doppler ambiguity interval: no tolerance is wider
CHUNK = 256  # scans that are worked on at once
STEPS = 3  # of refining


@dataclass(frozen=True, slots=True, eq=False)
class SensorVelocity:
    """Of those S scans that tell one: time (S,) s; velocity (S,) m/s, complex: x along boresight, y left; `support` (S,) the share of
    the scan's detections that agree; `agrees` (N,) which of all detections do.
    """

    time: Floats
    velocity: np.ndarray
    support: Floats
    agrees: Flags

    def __len__(self) -> int:
        return len(self.time)


def sensor_velocity(radar: RadarTrack) -> SensorVelocity:
    """Robust least squares in every scan: the best of many guesses from two detections, refined over those that agree."""
    time, velocity, support = [], [], []
    agrees = np.zeros(len(radar.range), dtype=np.bool_)
    counts = radar.counts
    usable = np.flatnonzero(counts >= LEAST)
    for begin in range(0, len(usable), CHUNK):
        rows = usable[begin : begin + CHUNK]
        index = radar.first[rows, None] + np.arange(counts[rows].max())  # (S, M)
        there = np.arange(index.shape[1]) < counts[rows, None]
        index = np.where(there, index, 0)
        slope = -np.stack((np.cos(radar.azimuth[index]), np.sin(radar.azimuth[index])), axis=-1)  # (S, M, 2)
        rate = radar.range_rate[index]
        interval = radar.ambiguity[rows, None]
        found, inside = _fit(slope, rate, there, interval, counts[rows])
        weight = inside.astype(float)
        normal = np.einsum("sm,smi,smj->sij", weight, slope, slope)
        number = weight.sum(axis=1)
        share = number / counts[rows]
        sharp = np.linalg.det(normal) > 0.02 * np.maximum(number, 1) ** 2 * 0.25
        kept = (number >= LEAST) & (share >= SHARE) & sharp
        time.append(radar.time[rows[kept]])
        velocity.append(found[kept, 0] + 1j * found[kept, 1])
        support.append(share[kept])
        agrees[index[inside & kept[:, None]]] = True
    if not time:
        return SensorVelocity(np.empty(0), np.empty(0, complex), np.empty(0), agrees)
    return SensorVelocity(np.concatenate(time), np.concatenate(velocity), np.concatenate(support), agrees)


def _fit(slope: Floats, rate: Floats, there: Flags, interval: Floats, counts: np.ndarray) -> tuple[Floats, Flags]:
    """(S, 2) velocities, and (S, M) which detections agree."""
    scans = np.arange(len(rate))[:, None]
    pairs = (PAIRS[None] * counts[:, None, None]).astype(np.intp)  # (S, K, 2)
    one, other = slope[scans, pairs[..., 0]], slope[scans, pairs[..., 1]]
    determinant = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    apart = np.abs(determinant) > APART
    determinant = np.where(apart, determinant, 1.0)
    rate_one, rate_other = rate[scans, pairs[..., 0]], rate[scans, pairs[..., 1]]
    guess = np.stack(
        (
            (rate_one * other[..., 1] - rate_other * one[..., 1]) / determinant,
            (rate_other * one[..., 0] - rate_one * other[..., 0]) / determinant,
        ),
        axis=-1,
    )  # (S, K, 2)
    left = _folded(rate[:, None] - np.einsum("smi,ski->skm", slope, guess), interval[:, None])
    agree = (np.abs(left) < _tolerance(guess, interval)[..., None]) & there[:, None] & apart[..., None]
    best = agree.sum(axis=2).argmax(axis=1)
    found = guess[scans[:, 0], best]
    inside: Flags = agree[scans[:, 0], best]
    for _ in range(STEPS):
        left = _folded(rate - np.einsum("smi,si->sm", slope, found), interval)
        normal = np.einsum("sm,smi,smj->sij", inside, slope, slope) + 1e-6 * np.eye(2)
        found = found + np.linalg.solve(normal, np.einsum("sm,smi,sm->si", inside, slope, left)[..., None])[..., 0]
        left = _folded(rate - np.einsum("smi,si->sm", slope, found), interval)
        inside = (np.abs(left) < _tolerance(found, interval[:, 0])[:, None]) & there
    return found, inside


def _tolerance(velocity: Floats, interval: Floats) -> Floats:
    """(…) for velocities (…, 2) and intervals that fit them."""
    tolerance = TOLERANCE + TOLERANCE_SHARE * np.hypot(velocity[..., 0], velocity[..., 1])
    return np.minimum(tolerance, np.where(interval > 0, WRAPPED * interval, np.inf))


def _folded(left: Floats, interval: Floats) -> Floats:
    """Modulo the Doppler ambiguity interval, where there is one."""
    known = np.where(interval > 0, interval, 1.0)
    return np.where(interval > 0, left - known * np.round(left / known), left)
