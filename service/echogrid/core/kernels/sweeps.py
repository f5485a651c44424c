"""The reference's loops over a cycle's detections: what stands, what moves, what is seen again, and the motion that most agree with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from echogrid.core.kernels.cells import Bytes, Floats, Integers, Mask


class GateVerdict(IntEnum):
    """On a detection: it stands; it moves, by its range rate; it seems to stand, but lies beside some that move; nobody asked."""

    STATIC = 0
    MOVING = 1
    BESIDE = 2
    UNASKED = 3


class Scan(IntEnum):
    """Columns of a scan's row: where its sensor is on the car (m, rad), how far it sees (m) and half of how wide (rad); how the car moved
    (m/s, rad/s); the Doppler ambiguity interval (m/s; 0: none) and the sigma that turning adds (m/s); where the car was in odom."""

    X = 0
    Y = 1
    YAW = 2
    RANGE = 3
    HALF_FOV = 4
    SPEED = 5
    YAW_RATE = 6
    AMBIGUITY = 7
    TURNING = 8
    CAR_X = 9
    CAR_Y = 10
    CAR_YAW = 11


def gathered(arrays: list[Floats], scans: Floats, columns: Floats, scan: Integers, near: Mask) -> None:
    """Detections of scans (S, 12), as Scan has them, scan by scan: `columns` (5, N) are azimuth, bearing in base, range, range rate and
    RCS, `scan` (N,) is each one's, and `near` (N,) within its mount's range. `arrays`: of each scan range, azimuth, range rate and RCS."""
    sizes = [len(one) for one in arrays[::4]]
    scan[:] = np.repeat(np.arange(len(sizes)), sizes)
    for row, first in zip((2, 0, 3, 4), range(4), strict=True):
        columns[row] = np.concatenate(arrays[first::4])
    columns[1] = columns[0] + scans[scan, Scan.YAW]
    near[:] = columns[2] <= scans[scan, Scan.RANGE]


def deviations(
    cos: Floats,
    sin: Floats,
    rate: Floats,
    near: Mask,
    sizes: Integers,
    scans: Floats,
    by_rate: float,
    by_azimuth: float,
    by_speed: float,
    limit: float,
    out: Floats,
    counts: Integers,
) -> None:
    """Out (N,): how many sigmas range rates are off those of standing points, for scans (S, 12), as Scan has them, `sizes` (S,) of each.
    `counts` (2, S): how many of each are `near`, and of these at most `limit` sigmas off.

    `cos` and `sin` (N,): of the bearings in base. Sigmas: m/s, rad, and a share of the rate that is expected.
    """
    scan = np.repeat(np.arange(len(sizes)), sizes)
    of = scans[scan].T
    vx, vy, interval = of[Scan.SPEED] - of[Scan.YAW_RATE] * of[Scan.Y], of[Scan.YAW_RATE] * of[Scan.X], of[Scan.AMBIGUITY]
    expected, slope = -(vx * cos + vy * sin), vx * sin - vy * cos
    left, known = rate - expected, np.where(interval > 0, interval, 1.0)
    left = np.where(interval > 0, left - known * np.rint(left / known), left)
    azimuth, speed, turning = slope * by_azimuth, expected * by_speed, of[Scan.TURNING]
    out[:] = np.abs(left) / np.sqrt(by_rate * by_rate + azimuth * azimuth + speed * speed + turning * turning)
    for row, which in zip(counts, (near, near & (out <= limit)), strict=True):
        row[:] = np.bincount(scan[which], minlength=len(sizes))


def sensors(scans: Floats, x: float, y: float, yaw: float, in_base: Floats, in_odom: Floats) -> None:
    """Where the sensors of scans (S, 12), as Scan has them, were: `in_base` (S, 4), of a car that is at x, y and yaw in odom: x, y, cosine
    and sine of their yaw; and `in_odom` (S, 3): x, y and yaw. Sines are those of Python's math, the C library's."""
    c, s = math.cos(yaw), math.sin(yaw)
    base_from_odom = -c * x - s * y, s * x - c * y, -yaw
    for row, base, odom in zip(scans.tolist(), in_base, in_odom, strict=True):
        there = _joined(_joined(base_from_odom, row[Scan.CAR_X :]), row[: Scan.RANGE])
        base[:] = there[0], there[1], math.cos(there[2]), math.sin(there[2])
        odom[:] = c * there[0] - s * there[1] + x, s * there[0] + c * there[1] + y, there[2] + yaw


def recalled(
    points: Floats,
    origins: Floats,
    travelled: Floats,
    update: Floats,
    sensors: Floats,
    x: float,
    y: float,
    yaw: float,
    distance: float,
    places: Floats,
    age: Floats,
    numbers: Integers,
    looks: Floats,
) -> None:
    """What is remembered in odom, for a car that is at x, y and yaw there after `distance` m of way: `places` (2, N, 2) of points and
    origins (N, 2) in its base, `age` (N,) since they were measured at `travelled` (N,), `numbers` (N,) of their `update` (N,); and `looks`
    (S, 3) of sensors (S, 3): x, y and yaw."""
    c, s = math.cos(yaw), math.sin(yaw)
    u, v, turn = -c * x - s * y, s * x - c * y, -yaw
    c, s = math.cos(turn), math.sin(turn)
    for there, here in zip((points, origins, sensors), (*places, looks), strict=True):
        here[:, 0] = c * there[:, 0] - s * there[:, 1] + u
        here[:, 1] = s * there[:, 0] + c * there[:, 1] + v
    looks[:, 2] = sensors[:, 2] + turn
    age[:] = distance - travelled
    numbers[:] = update


def _joined(a_from_b: Sequence[float], b_from_c: Sequence[float]) -> tuple[float, float, float]:
    """As SE2 does it."""
    (x, y, yaw), (u, v, turn) = a_from_b, b_from_c
    c, s = math.cos(yaw), math.sin(yaw)
    return x + c * u - s * v, y + s * u + c * v, yaw + turn


def placed(
    range_: Floats, cos: Floats, sin: Floats, sizes: Integers, in_base: Floats, in_odom: Floats, x: float, y: float, yaw: float, out: Floats
) -> None:
    """Where detections of scans lie, `sizes` (S,) of each, by the `cos` and `sin` (N,) of their azimuths and sensors as `sensors` has them.
    Out (N, 6): x and y in base; in odom; and in odom of the sensor that measured it."""
    u, v, cosine, sine = np.repeat(in_base, sizes, axis=0).T
    along, aside = range_ * cos, range_ * sin
    out[:, 0] = cosine * along - sine * aside + u
    out[:, 1] = sine * along + cosine * aside + v
    c, s = math.cos(yaw), math.sin(yaw)
    out[:, 2] = c * out[:, 0] - s * out[:, 1] + x
    out[:, 3] = s * out[:, 0] + c * out[:, 1] + y
    out[:, 4:] = np.repeat(in_odom[:, :2], sizes, axis=0)


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
) -> None:
    """Twice, of those detections (N,) that are `near` and of those up to `reach` m far, by GateVerdict: what is more than `limit` sigmas
    off a standing thing moves, and what lies within `radius` m of at least two such is beside them. `verdicts` (N,) of the first time;
    `static` (2, N + 1): how many of them stand, and which."""
    asked = np.stack((near, range_ <= reach))
    for which, standing in zip(asked[::-1], static[::-1], strict=True):
        some = np.flatnonzero(which)
        moving, near = ~(sigmas[some] <= limit), np.empty(len(some), np.bool_)
        beside(points[some], moving, np.array([len(some)]), radius, near)
        verdicts[:] = GateVerdict.UNASKED
        verdicts[some] = np.where(moving, GateVerdict.MOVING, np.where(near, GateVerdict.BESIDE, GateVerdict.STATIC))
        stands = np.flatnonzero(verdicts == GateVerdict.STATIC)
        standing[0], standing[1 : len(stands) + 1] = len(stands), stands


def beside(points: Floats, moving: Mask, sizes: Integers, radius: float, out: Mask) -> None:
    """(N,) which of the points of scans, `sizes` (S,) of each, have at least two `moving` ones of their scan less than `radius` m away."""
    scan = np.repeat(np.arange(len(sizes)), sizes)
    away = points[:, None, :] - points[moving][None, :, :]
    out[:] = (((away * away).sum(axis=2) < radius * radius) & (scan[:, None] == scan[moving])).sum(axis=1) >= 2


def standing(
    range_: Floats,
    cos: Floats,
    sin: Floats,
    sizes: Integers,
    sigmas: Floats,
    limit: float,
    radius: float,
    nearest: float,
    out: Mask,
) -> None:
    """(N,) which detections of scans, `sizes` (S,) of each, are more than `nearest` m away, at most `limit` sigmas off a standing thing,
    and not `beside` such as are more. `cos` and `sin` (N,): of their azimuths."""
    moving = sigmas > limit
    beside(np.stack((range_ * cos, range_ * sin), axis=1), moving, sizes, radius, out)
    out[:] = ~(moving | out) & (range_ > nearest)


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
    scans: Floats,
    pairs: Floats,
    apart: float,
    tolerance: float,
    out: Floats,
) -> None:
    """Of guesses from pairs of the detections (N,) that are `near`, as shares (2, P) of their number, the motion that explains the most
    range rates to `tolerance` m/s, refined by least squares over those.

    Out (7,): speed (m/s), yaw rate (rad/s), whether any pair was `apart` enough, by its determinant, how many are near, how many of these
    the refined one explains, and the sums of the cosines and sines of those.

    Detections by the cosine and sine (N,) of their bearing in base, scan by scan: `sizes` (S,) of scans (S, 12), as Scan has them, modulo
    whose ambiguity interval rates are compared. Sums go from the first detection to the last.
    """
    x, y, interval = np.repeat(scans[:, (Scan.X, Scan.Y, Scan.AMBIGUITY)], sizes, axis=0)[near].T
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
