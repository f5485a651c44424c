"""The reference's loops over a cycle's detections: what stands, what moves, what is seen again, and the motion that most agree with."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from echogrid.core.kernels.cells import Bytes, Floats, Integers, Mask


class GateVerdict(IntEnum):
    """On a detection: it stands; it moves, by its range rate; it seems to stand, but lies beside some that move; nobody asked."""

    STATIC = 0
    MOVING = 1
    BESIDE = 2
    UNASKED = 3


def gathered(
    ranges: list[Floats],
    azimuths: list[Floats],
    rates: list[Floats],
    rcs: list[Floats],
    mounts: Floats,
    columns: Floats,
    scan: Integers,
    near: Mask,
) -> None:
    """Detections of scans (S), scan by scan: `columns` (5, N) are azimuth, bearing in base, range, range rate and RCS, `scan` (N,) is each
    one's, and `near` (N,) within its mount's range. `mounts` (S, 2): yaw and range."""
    sizes = [len(one) for one in ranges]
    scan[:] = np.repeat(np.arange(len(sizes)), sizes)
    for row, of_scans in zip((0, 2, 3, 4), (azimuths, ranges, rates, rcs), strict=True):
        columns[row] = np.concatenate(of_scans)
    columns[1] = columns[0] + mounts[scan, 0]
    near[:] = columns[2] <= mounts[scan, 1]


def agreeing(sizes: Integers, near: Mask, sigmas: Floats, limit: float, out: Integers) -> None:
    """Of scans (S,) with so many detections: out (2, S) counts those that are near, and those of them that are at most `limit` sigmas
    off."""
    scan = np.repeat(np.arange(len(sizes)), sizes)
    for row, which in zip(out, (near, near & (sigmas <= limit)), strict=True):
        row[:] = np.bincount(scan[which], minlength=len(sizes))


def gated(
    points: Floats,
    sigmas: Floats,
    near: Mask,
    range_: Floats,
    reach: float,
    limit: float,
    radius: float,
    verdicts: Bytes,
    static: Integers,
    found: Integers,
) -> None:
    """Twice, of those detections (N,) that are `near` and of those up to `reach` m far, by GateVerdict: what is more than `limit` sigmas
    off a standing thing moves, and what lies within `radius` m of at least two such is beside them. `verdicts` (N,) of the first time;
    `static` (2, N) which ones stand, `found` (2,) how many of them there are."""
    asked = np.stack((near, range_ <= reach))
    for which, standing, count in zip(asked[::-1], static[::-1], found[::-1, None], strict=True):
        some = np.flatnonzero(which)
        moving, near = ~(sigmas[some] <= limit), np.empty(len(some), np.bool_)
        beside(points[some], moving, np.array([len(some)]), radius, near)
        verdicts[:] = GateVerdict.UNASKED
        verdicts[some] = np.where(moving, GateVerdict.MOVING, np.where(near, GateVerdict.BESIDE, GateVerdict.STATIC))
        stands = np.flatnonzero(verdicts == GateVerdict.STATIC)
        standing[: len(stands)], count[0] = stands, len(stands)


def beside(points: Floats, moving: Mask, sizes: Integers, radius: float, out: Mask) -> None:
    """(N,) which of the points of scans, `sizes` (S,) of each, have at least two `moving` ones of their scan less than `radius` m away."""
    scan = np.repeat(np.arange(len(sizes)), sizes)
    away = points[:, None, :] - points[moving][None, :, :]
    out[:] = (((away * away).sum(axis=2) < radius * radius) & (scan[:, None] == scan[moving])).sum(axis=1) >= 2


def leanings(
    cos: Floats,
    sin: Floats,
    azimuth: Floats,
    rate: Floats,
    x: float,
    y: float,
    wheels: float,
    gyro: float,
    speed: float,
    yaw_rate: float,
    acceleration: float,
    turn_acceleration: float,
    too_high: float,
    interval: float,
    covariance: Floats,
    by_rate: float,
    by_azimuth: float,
    by_distortion: float,
    limit: float,
    worth: float,
    most: float,
    slipping: float,
    slope: Floats,
    left: Floats,
    weight: Floats,
) -> None:
    """How range rates (N,) lean on seven errors, of which `covariance` (7, 7) is: wheel scale, gyro's bias and scale, delay, yaw of the
    mount, stretch of azimuths, and the rate that all are `too_high` by. `slope` (N, 7) are the derivatives, `left` (N,) what the motion
    leaves of the rates, modulo the interval if there is one, `weight` (N,) inverse variances, 0 for what is more than `limit` sigmas off.

    Detections of one scan by cosine and sine of their bearings in base, from a sensor at x, y (m). `wheels` and `gyro` as they are, speed
    and yaw rate as they should be. Sigmas: m/s, rad, rad; `worth` variances a detection counts as, at most `most` of them whole, and
    `slipping` times as many.
    """
    lever = y * cos - x * sin
    by_bearing = speed * sin - yaw_rate * (y * sin + x * cos)
    columns = (cos * -wheels, -lever, lever * gyro, lever * turn_acceleration - cos * acceleration, by_bearing, by_bearing * azimuth)
    for row, column in zip(slope.T, (*columns, 1.0), strict=True):
        row[:] = column
    left[:] = rate - (yaw_rate * lever - speed * cos + too_high)
    if interval > 0:
        left -= interval * np.rint(left / interval)
    variance = by_rate * by_rate + (by_bearing * by_azimuth) * (by_bearing * by_azimuth)
    doubt = np.zeros(len(cos))
    for j in range(7):
        along = np.zeros(len(cos))
        for i in range(7):
            along += slope[:, i] * covariance[i, j]
        doubt += along * slope[:, j]
    stands = left * left < limit * limit * (variance + doubt)
    counts = worth * max(1.0, np.count_nonzero(stands) / most) * slipping
    weight[:] = np.where(stands, 1.0 / (counts * (variance + (by_bearing * by_distortion) * (by_bearing * by_distortion))), 0.0)


def possible(azimuth: Floats, rate: Floats, widest: float, fastest: float, out: Integers) -> None:
    """Out (1,): of detections (N,), how many lie within `widest` rad of boresight and are at most as fast as `fastest`."""
    out[0] = np.count_nonzero((np.abs(azimuth) <= widest) & (np.abs(rate) <= fastest))


def nearby(points: Floats, reach: Floats, radars: Integers, older: Floats, of: Integers, pairs: Integers, found: Integers) -> None:
    """Of points (N, 2) with those of the `older` (M, 2) that the same radar saw and that are less than `reach` (N,) away: `pairs`
    (2, N * M) of their numbers, point by point, and how many, `found` (1,)."""
    apart = points[:, None] - older
    near = (apart[..., 0] * apart[..., 0] + apart[..., 1] * apart[..., 1] < (reach * reach)[:, None]) & (radars[:, None] == of)
    both = np.stack(np.nonzero(near))
    found[0] = both.shape[1]
    pairs[:, : both.shape[1]] = both


def common_motion(
    cos: Floats,
    sin: Floats,
    rate: Floats,
    near: Mask,
    sizes: Integers,
    places: Floats,
    pairs: Floats,
    apart: float,
    tolerance: float,
    out: Floats,
) -> None:
    """Of guesses from pairs of the detections (N,) that are `near`, as shares (2, P) of their number, the motion that explains the most
    range rates to `tolerance` m/s, refined by least squares over those.

    Out (7,): speed (m/s), yaw rate (rad/s), whether any pair was `apart` enough, by its determinant, how many are near, how many of these
    the refined one explains, and the sums of the cosines and sines of those.

    Detections by the cosine and sine (N,) of their bearing in base, scan by scan: `sizes` (S,) with places (S, 3), x and y of the sensor
    (m) and the Doppler ambiguity interval (m/s, 0: none), modulo which rates are compared. Sums go from the first detection to the last.
    """
    x, y, interval = np.repeat(places, sizes, axis=0)[near].T
    cos, sin, rate = cos[near], sin[near], rate[near]
    slope = np.stack((-cos, y * cos - x * sin), axis=1)  # (N, 2) derivatives of a standing point's range rate by speed and yaw rate

    def left_by(motion: Floats) -> Floats:
        """(..., N) of the range rates, by motions (..., 2)."""
        left = rate - (motion[..., :1] * slope[:, 0] + motion[..., 1:] * slope[:, 1])
        known = np.where(interval > 0, interval, 1.0)
        found: Floats = np.where(interval > 0, left - known * np.rint(left / known), left)
        return found

    out[:] = 0.0
    out[3] = len(rate)
    one, other = (pairs * len(rate)).astype(np.int64) if len(rate) else np.zeros((2, 0), np.int64)
    (a, b), (c, d), p, q = slope[one].T, slope[other].T, rate[one], rate[other]
    determinant = a * d - b * c
    enough = np.abs(determinant) > apart
    if not enough.any():
        return
    guesses = np.stack((p * d - b * q, a * q - p * c), axis=1)[enough] / determinant[enough, None]
    best = guesses[(np.abs(left_by(guesses)) < tolerance).sum(axis=1).argmax()]
    left = left_by(best)
    chosen = np.abs(left) < tolerance
    (u, v), r = slope[chosen].T, left[chosen]
    uu, uv, vv, ur, vr = (np.add.accumulate(terms)[-1] for terms in (u * u, u * v, v * v, u * r, v * r))
    out[:2] = best + np.array((ur * vv - uv * vr, uu * vr - ur * uv)) / (uu * vv - uv * uv)
    explained = np.abs(left_by(out[:2])) < tolerance
    out[2], out[4] = 1.0, np.count_nonzero(explained)
    out[5:] = [np.add.accumulate(np.append(0.0, terms[explained]))[-1] for terms in (cos, sin)]
