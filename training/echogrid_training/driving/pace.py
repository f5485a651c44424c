"""How fast a driver goes along a course, and the track that comes of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echogrid.core.messages import Floats
from echogrid_training.driving.steering import STEP, Course
from echogrid_training.towns.town import Track

SLOWEST = 0.4  # m/s: to start with, so that the first step takes a time
FOOT = 0.25  # s: over which a driver changes the acceleration, one sigma


@dataclass(frozen=True, slots=True)
class Manner:
    """A driver's (or walker's) habits: the most they accelerate, brake and corner with, m/s²."""

    accelerate: float = 1.6
    brake: float = 1.7
    corner: float = 1.75


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A course with what it is driven at, at most (N,) m/s per point; halts are places (m along the course) and seconds."""

    course: Course
    limit: Floats
    halts: tuple[tuple[float, float], ...] = ()
    rest: float = 0.0  # s, at its end


def track(runs: Sequence[Run], manner: Manner, rate: float = 100.0) -> Track:
    """Driven one after the other from rest to rest, sampled `rate` times per second."""
    speeds, turns = [np.zeros(1)], [np.zeros(1)]  # per sample: m/s along the motion, 1/m
    signs = [np.zeros(1)]
    for run in runs:
        speed, place = _timed(run, manner, rate)
        speeds.append(speed)
        turns.append(np.interp(place, np.arange(len(run.course.curvature)) * STEP, run.course.curvature))
        signs.append(np.full(len(speed), -1.0 if run.course.reverse else 1.0))
    speed, turn = np.concatenate(speeds), np.concatenate(turns)
    sign = np.concatenate(signs)
    yaw_rate = turn * speed
    moved = (speed[1:] + speed[:-1]) / 2 / rate * sign[1:]
    turned = (yaw_rate[1:] + yaw_rate[:-1]) / 2 / rate
    start = runs[0].course.start
    yaw = start.yaw + np.concatenate(([0.0], np.cumsum(turned)))
    middle = (yaw[1:] + yaw[:-1]) / 2
    chord = moved * np.sinc(turned / 2 / math.pi)  # of an arc of that length and turn
    return Track(
        time=np.arange(len(yaw)) / rate,
        x=start.x + np.concatenate(([0.0], np.cumsum(chord * np.cos(middle)))),
        y=start.y + np.concatenate(([0.0], np.cumsum(chord * np.sin(middle)))),
        yaw=yaw,
        speed=speed * sign,
        yaw_rate=yaw_rate,
    )


def _timed(run: Run, manner: Manner, rate: float) -> tuple[Floats, Floats]:
    """Speed and place along the course at samples from just after its start to the end of its rest."""
    count = len(run.course.curvature)
    most = np.minimum(run.limit, np.sqrt(manner.corner / np.maximum(np.abs(run.course.curvature), 1e-6)))
    halts = sorted(
        (min(max(round(place / STEP), 1), count - 1), seconds) for place, seconds in run.halts if place < run.course.length - 1.0
    )
    halts.append((count - 1, run.rest))
    speeds, places, first = [], [], 0
    for last, seconds in halts:
        if last <= first:
            continue
        speed = _smooth(_between_halts(most[first : last + 1], manner, rate), seconds, rate)
        walked = np.cumsum((speed + np.concatenate(([0.0], speed[:-1]))) / 2) / rate
        scale = (last - first) * STEP / max(walked[-1], 1e-9)  # of a thousandth or so, from sampling
        speeds.append(speed * scale)
        places.append(first * STEP + walked * scale)
        first = last
    return np.concatenate(speeds), np.concatenate(places)


def _between_halts(most: Floats, manner: Manner, rate: float) -> Floats:
    """Speed over time, from rest to rest, as fast as `most` (N,) m/s per step and the driver allow."""
    speed = most.copy()
    speed[0] = speed[-1] = 0.0
    speed = _limited(speed, manner.accelerate)
    speed = _limited(speed[::-1], manner.brake)[::-1]
    pace = np.maximum((speed[1:] + speed[:-1]) / 2, SLOWEST / 4)
    time = np.concatenate(([0.0], np.cumsum(STEP / pace)))
    samples = np.arange(1, max(2, math.ceil(time[-1] * rate) + 1)) / rate
    return np.interp(samples, time, speed)


def _limited(speed: Floats, most: float) -> Floats:
    """The speed per step such that v² grows by no more than 2·most·STEP from each to the next."""
    squares = speed * speed
    rise = 2 * most * STEP * np.arange(len(squares))
    limited: Floats = np.sqrt(np.minimum.accumulate(squares - rise) + rise)
    return limited


def _smooth(speed: Floats, rest: float, rate: float) -> Floats:
    """Without steps of acceleration; standing for `rest` s follows, and for long enough that the smoothing ends."""
    half = round(3 * FOOT * rate)
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / (FOOT * rate)) ** 2)
    smoothed = np.convolve(speed, kernel / kernel.sum())
    return np.concatenate((smoothed, np.zeros(max(1, round(rest * rate)))))


def clip(whole: Track, start: float, seconds: float) -> Track:
    """From `start` s on for `seconds`, its clock set to 0; it stands where it ended if it is shorter."""
    rate = 1.0 / (whole.time[1] - whole.time[0])
    first = round(start * rate)
    samples = first + np.arange(round(seconds * rate) + 1)
    inside = np.minimum(samples, len(whole.time) - 1)
    moving = samples < len(whole.time)
    return Track(
        time=np.arange(len(samples)) / rate,
        x=whole.x[inside],
        y=whole.y[inside],
        yaw=whole.yaw[inside],
        speed=np.where(moving, whole.speed[inside], 0.0),
        yaw_rate=np.where(moving, whole.yaw_rate[inside], 0.0),
    )
