"""What the values alone say: leaps, units and scales, before any mount is looked at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.trust.motion_watch import ACCELERATION, FASTEST, SPEED_NOISE, TURNING, YAW_ACCELERATION, YAW_NOISE
from echogrid.judging.recorded import RadarTrack, Recorded, Track
from echogrid.judging.sensor_velocity import LEAST, sensor_velocity

LEAPS = 0.02  # share of the steps that may be as no car moves
TRIAL = 80  # scans that a factor of azimuths is tried on
AZIMUTH_FACTORS = (1.0, 57.2958, 0.0174533, 2.0, 0.5)
BETTER, GOOD = 0.12, 0.5  # more support that another factor must give, and what it must reach: noise fits a little too
FEWEST = 20  # scans with which anything is said
DENSE = 12.0  # detections in a scan from which on a low support means something
RANGE_FACTORS = (1.0, 100.0, 0.01, 10.0, 0.1, 2.0, 0.5, 1.25, 0.8, 1.6, 0.625)
AHEAD = 0.15  # s between two scans whose ranges are compared
NEAR_AZIMUTH, NEAR_RATE, GONE, FIT = 0.1, 0.3, 0.4, 0.15  # rad, m/s, m that it moved at least, m
ASIDE = 0.5  # m: there, and twice as far, chance alone brings pairs
CLEAR = 8.0  # sigmas of chance from which on a factor is believed
STANDS, STANDS_SHARE, FASTER = 0.25, 0.01, 5.0  # m/s, and of the speed: by how much what stands may be off; m/s from which on it counts
APART = 0.03  # m/s by which the rear wheels must differ in bends, to say which way round they are
NEAREST, FARTHEST = 0.5, 200.0  # m, between which the middle of all ranges must lie
PAIRS = 2000  # that must be there to say that none fits


def leaping(track: Track, most: float, rate: float, noise: float) -> float:
    """Share of the steps, or of the values, that no car can show."""
    if len(track) < 10:
        return 0.0
    step = np.minimum(np.diff(track.time), 0.1)
    leaps = np.abs(np.diff(track.value)) > noise + rate * step
    return max(float(leaps.mean()), float(np.mean(np.abs(track.value) > most)))


def speed_leaps(speed: Track) -> float:
    return leaping(speed, 3.6 * FASTEST, ACCELERATION * 3.6, SPEED_NOISE)  # as km/h they do not leap yet


def yaw_rate_leaps(yaw_rate: Track) -> float:
    """Whether in rad/s, or too large by 57.3."""
    if np.max(np.abs(yaw_rate.value), initial=0.0) > TURNING:
        return leaping(yaw_rate, 57.3 * TURNING, 57.3 * YAW_ACCELERATION, 57.3 * YAW_NOISE)
    return leaping(yaw_rate, TURNING, YAW_ACCELERATION, YAW_NOISE)


def azimuth_factor(radar: RadarTrack) -> tuple[float, float, float]:
    """By what azimuths must be multiplied so that the range rates of a scan fit one velocity; the support with it, and as they are.

    Mean share of a scan's detections that fit, over a few scans in which the radar moves; 1 where there are too few.
    """
    few = _subset(radar, TRIAL)
    if len(few) < FEWEST:
        return 1.0, 1.0, 1.0
    support = [_support(replace(few, azimuth=few.azimuth * factor)) for factor in AZIMUTH_FACTORS]
    best = int(np.argmax(support))
    believed = support[best] > max(support[0] + BETTER, GOOD)
    if not believed and len(few.range) < DENSE * len(few):
        return 1.0, 1.0, 1.0
    return (AZIMUTH_FACTORS[best] if believed else 1.0), support[best], support[0]


def range_factor(radar: RadarTrack) -> tuple[float, float, float]:
    """By what ranges must be multiplied so that they change as the range rates say; its score, and that of 1, in sigmas of chance.

    Detections of scans about 0.15 s apart, at about the same azimuth and range rate: pairs of one thing lie where the range rate has
    brought it, all others anywhere.
    """
    gone, change = _pairs(radar)
    scores = [_score(change * factor, gone) for factor in RANGE_FACTORS]
    best = int(np.argmax(scores))
    clear = scores[best] > CLEAR and scores[best] > 2 * max(scores[0], 1.0)
    return (RANGE_FACTORS[best] if clear else 1.0), scores[best], scores[0]


def range_unit(radar: RadarTrack) -> float:
    """By what ranges must be multiplied for half of them not to lie in the car or beyond the sight of any radar; 1 if they do not."""
    if len(radar.range) < PAIRS:
        return 1.0
    middle = float(np.median(radar.range))
    return next((factor for factor in (1.0, 100.0, 0.01) if NEAREST < middle * factor < FARTHEST), 1.0)


def ranges_say(radar: RadarTrack, ratio: float) -> int:
    """Whether ranges change from scan to scan as the range rates say: 1; or as 1 / `ratio` of them: -1; 0 where neither is clear."""
    if ratio == 1.0:
        return 0
    as_given, otherwise = (_score(*_pairs(one)[::-1]) for one in (radar, replace(radar, range_rate=radar.range_rate / ratio)))
    if max(as_given, otherwise) < CLEAR or max(as_given, otherwise) < 2 * min(as_given, otherwise):
        return 0
    return 1 if as_given > otherwise else -1


def ranges_leap(radar: RadarTrack) -> bool:
    """Whether the ranges change without any regard to the range rates, though there is much to compare."""
    if not len(radar.range) or np.median(radar.range) < 60.0:
        return False
    gone, change = _pairs(radar)
    if len(gone) < PAIRS:
        return False
    return max(_score(change * factor, gone) for factor in RANGE_FACTORS) < CLEAR / 2


def _score(change: Floats, gone: Floats) -> float:
    if len(gone) < 20:
        return 0.0
    off = change - gone
    hit, near, far = (float(np.count_nonzero(np.abs(np.abs(off) - aside) < FIT)) for aside in (0.0, ASIDE, 2 * ASIDE))
    near, far = near / 2, far / 2
    chance = max((4 * near - far) / 3, 0.0)  # where the density has a slope and bends, as that of the nearest detections does
    return (hit - chance) / math.sqrt(max(near, far) * 2 + 1)


def _pairs(radar: RadarTrack) -> tuple[Floats, Floats]:
    """By how much pairs of detections should have moved (m) by their range rate, and by how much their ranges differ."""
    if len(radar) < 20:
        return np.empty(0), np.empty(0)
    ahead = max(1, round(AHEAD / max(float(np.median(np.diff(radar.time))), 1e-3)))
    gone, change = [], []
    for one in range(0, len(radar) - ahead, max(1, len(radar) // 400)):
        time = radar.time[one + ahead] - radar.time[one]
        if not 0 < time < 3 * AHEAD:
            continue
        a, b = (slice(radar.first[n], radar.first[n + 1]) for n in (one, one + ahead))
        rate, later = radar.range_rate[a][:, None], radar.range_rate[b][None]
        near = np.abs(radar.azimuth[a][:, None] - radar.azimuth[b][None]) < NEAR_AZIMUTH
        i, j = np.nonzero(near & (np.abs(rate - later) < NEAR_RATE) & (np.abs(rate * time) > GONE))
        gone.append(radar.range_rate[a][i] * time)
        change.append(radar.range[b][j] - radar.range[a][i])
    return (np.concatenate(gone), np.concatenate(change)) if gone else (np.empty(0), np.empty(0))


def _subset(radar: RadarTrack, most: int) -> RadarTrack:
    """The scans with most spread of range rates among those with enough detections, evenly over the drive."""
    usable = np.flatnonzero(radar.counts >= LEAST)
    spread = np.array([np.ptp(radar.range_rate[radar.first[n] : radar.first[n + 1]]) for n in usable])
    usable = usable[spread > 1.0] if len(usable) else usable
    return scans_of(radar, usable[np.linspace(0, len(usable) - 1, min(most, len(usable))).astype(np.intp)])


def scans_of(radar: RadarTrack, chosen: Sequence[int] | np.ndarray) -> RadarTrack:
    """The radar with some of its scans alone."""
    index = np.concatenate([np.arange(radar.first[n], radar.first[n + 1]) for n in chosen] or [np.empty(0, np.intp)])
    chosen = np.asarray(chosen, dtype=np.intp)
    return replace(
        radar,
        time=radar.time[chosen],
        first=np.concatenate(([0], np.cumsum(radar.counts[chosen]))).astype(np.intp),
        range=radar.range[index],
        azimuth=radar.azimuth[index],
        range_rate=radar.range_rate[index],
        ambiguity=radar.ambiguity[chosen],
        blockage=radar.blockage[chosen],
    )


def _support(radar: RadarTrack) -> float:
    """Mean share of a scan's detections that fit one velocity, with wide-spread azimuths; 0 for scans that tell none."""
    seen = sensor_velocity(radar)
    return float(seen.support.sum()) / len(radar)


def wheels_say(recorded: Recorded) -> int:
    """Whether the right rear wheel is the faster one where the car turns left by its yaw rate: 1, the slower one: -1, or neither: 0."""
    apart, rate = recorded.difference, recorded.yaw_rate
    if len(apart) < 100 or len(rate) < 2:
        return 0
    turning = rate.at(apart.time)
    columns = np.stack((turning - turning.mean(), recorded.speed.value, np.ones(len(apart))), axis=1)  # uneven wheels differ by the speed
    found = np.linalg.lstsq(columns, apart.value)[0]
    told, left = float(found[0] * turning.std()), float(np.std(apart.value - columns @ found))
    return int(math.copysign(1, told)) if abs(told) > max(APART, 2 * left) else 0


def stands_out(radar: RadarTrack, speed: Track, yaw_rate: Track) -> bool:
    """Whether some of the little that a radar sees surely stands, by its mount and ego motion, however much of it moves.

    More range rates are where standing things have them than beside that, where slow movers would be. Where it sees much, most stands.
    """
    if len(radar.range) >= DENSE * len(radar):
        return False
    place, scan = radar.mount.base_from_sensor, radar.scan
    v, w = speed.at(radar.time)[scan], yaw_rate.at(radar.time)[scan]
    bearing = radar.azimuth + place.yaw
    left = radar.range_rate + (v - w * place.y) * np.cos(bearing) + w * place.x * np.sin(bearing)
    width = STANDS + STANDS_SHARE * np.abs(v)
    moving = np.abs(v) > FASTER
    hits = [int(np.count_nonzero(moving & (np.abs(left - aside * width) < width))) for aside in (0, -6, -4, 4, 6)]
    chance = float(np.mean(hits[1:]))
    return hits[0] > 2 * chance and (hits[0] - chance) / math.sqrt(chance + 1) > CLEAR
