"""What is in sight from a place: rays and points against vertical surfaces, seen from above as segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid_training.towns.town import Mover, Track

Indices = NDArray[np.intp]

SLACK = 1e-9  # rad: rays through the corner that two sides share meet at least one of them
BLOCK = 16.0  # m: what is near is looked up once per square of this size


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """Where rays cross segments, in no order: which ray, which segment, and how far from the rays' origin (m); (P,) each."""

    ray: Indices
    segment: Indices
    distance: Floats


def crossings(segments: Floats, origin: Floats, bearings: Floats) -> Crossings:
    """All crossings of the rays from `origin` (2,) along `bearings` (N,) rad with the segments (S, 2, 2).

    A segment is compared only with the bearings between those of its ends, so the effort grows with the crossings there are.
    """
    order = np.argsort(np.remainder(bearings, 2 * np.pi))
    around = np.remainder(bearings, 2 * np.pi)[order]
    around = np.concatenate((around, around + 2 * np.pi))  # the span of a segment's bearings may pass 0
    gap = segments - origin
    ends = np.arctan2(gap[..., 1], gap[..., 0])
    span = np.remainder(ends[:, 1] - ends[:, 0] + np.pi, 2 * np.pi) - np.pi
    lowest = np.remainder(np.where(span < 0, ends[:, 1], ends[:, 0]), 2 * np.pi)
    first = np.searchsorted(around, lowest - SLACK)
    counts = np.searchsorted(around, lowest + np.abs(span) + SLACK) - first
    counts = np.minimum(counts, len(bearings))
    segment = np.repeat(np.arange(len(segments)), counts)
    nth = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)
    ray = order[(first[segment] + nth) % max(len(bearings), 1)]

    along = segments[segment, 1] - segments[segment, 0]
    start = gap[segment, 0]
    cos, sin = np.cos(bearings)[ray], np.sin(bearings)[ray]
    with np.errstate(divide="ignore", invalid="ignore"):  # a ray along a segment does not cross it
        distance = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / (cos * along[:, 1] - sin * along[:, 0])
    ahead = np.isfinite(distance) & (distance > 0)
    return Crossings(ray[ahead], segment[ahead], distance[ahead])


def losses(segments: Floats, loss: Floats, origin: Floats, points: Floats, margin: float = 0.05) -> Floats:
    """(N,) the sum of `loss` (S,) over the segments between `origin` and each point (N, 2), those within `margin` m of it left out."""
    gap = points - origin
    distance = np.hypot(gap[:, 0], gap[:, 1])
    found = crossings(segments, origin, np.arctan2(gap[:, 1], gap[:, 0]))
    before = found.distance < distance[found.ray] - margin
    return np.bincount(found.ray[before], weights=loss[found.segment[before]], minlength=len(points)).astype(np.float64)


def in_sight(segments: Floats, origin: Floats, points: Floats, margin: float = 0.05) -> NDArray[np.bool_]:
    """(N,) whether nothing lies between `origin` and each point (N, 2), up to `margin` m before it."""
    free: NDArray[np.bool_] = losses(segments, np.ones(len(segments)), origin, points, margin) == 0
    return free


def nearest_points(segments: Floats, origin: Floats) -> Floats:
    """(S, 2) the point of each segment (S, 2, 2) that is nearest to `origin`."""
    along = segments[:, 1] - segments[:, 0]
    length2 = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((origin - segments[:, 0]) * along).sum(axis=1) / length2, 0.0, 1.0)
    nearest: Floats = segments[:, 0] + share[:, None] * along
    return nearest


class Near:
    """Which of many segments (S, 2, 2) come within `reach` m of a place. It remembers the answer per block of the plane.

    The answer holds everywhere in the block of the place asked for, so it may hold a little more than is in reach. Points are segments
    without length.
    """

    def __init__(self, segments: Floats, reach: float) -> None:
        self.segments = segments
        self.reach = reach + BLOCK / np.sqrt(2.0)
        self._known: dict[tuple[int, int], Indices] = {}

    def __call__(self, origin: Floats) -> Indices:
        """Indices of the segments around `origin` (2,), increasing."""
        block = (int(origin[0] // BLOCK), int(origin[1] // BLOCK))
        if block not in self._known:
            centre = (np.array(block) + 0.5) * BLOCK
            gap = nearest_points(self.segments, centre) - centre
            self._known[block] = np.flatnonzero(np.hypot(gap[:, 0], gap[:, 1]) <= self.reach)
        return self._known[block]


def poses_at(track: Track, times: Floats) -> Track:
    """The track at other times (s) within its own, along arcs of constant speed and yaw rate from one of its poses towards the next."""
    before = np.clip(np.searchsorted(track.time, times, side="right") - 1, 0, max(len(track.time) - 2, 0))
    step = times - track.time[before]
    speed = np.interp(times, track.time, track.speed)
    yaw_rate = np.interp(times, track.time, track.yaw_rate)
    turn = (track.yaw_rate[before] + yaw_rate) / 2 * step
    chord = (track.speed[before] + speed) / 2 * step * np.sinc(turn / (2 * np.pi))
    heading = track.yaw[before] + turn / 2
    x, y = track.x[before] + chord * np.cos(heading), track.y[before] + chord * np.sin(heading)
    return Track(times, x, y, track.yaw[before] + turn, speed, yaw_rate)


@dataclass(frozen=True, slots=True, eq=False)
class Presence:
    """Movers that are there at one time: which, and their poses and motion; (M,) each."""

    mover: Indices
    x: Floats  # m, of the centre
    y: Floats
    yaw: Floats  # rad
    speed: Floats  # m/s along yaw
    yaw_rate: Floats  # rad/s
    length: Floats  # m
    width: Floats

    def segments(self) -> Floats:
        """(4 M, 2, 2) m: the sides of their boxes, four by four, counter-clockwise."""
        along = np.stack((np.cos(self.yaw), np.sin(self.yaw)), axis=-1) * self.length[:, None] / 2
        across = np.stack((-np.sin(self.yaw), np.cos(self.yaw)), axis=-1) * self.width[:, None] / 2
        centre = np.stack((self.x, self.y), axis=-1)
        corners = np.stack((centre + along + across, centre - along + across, centre - along - across, centre + along - across), axis=1)
        return np.stack((corners, np.roll(corners, -1, axis=1)), axis=2).reshape(-1, 2, 2)


class Traffic:
    """The movers at the times (T,) s, worked out at once. A mover is there from the first to the last time of its track."""

    def __init__(self, movers: Sequence[Mover], times: Floats) -> None:
        tracks = [poses_at(mover.track, times) for mover in movers]
        there = [(mover.track.time[0] <= times) & (times <= mover.track.time[-1]) for mover in movers]
        self.there = np.array(there, dtype=bool).reshape(len(movers), len(times))
        columns = ("x", "y", "yaw", "speed", "yaw_rate")
        self.states = np.array([[getattr(track, column) for column in columns] for track in tracks]).reshape(len(movers), 5, len(times))
        self.size = np.array([(mover.length, mover.width) for mover in movers]).reshape(-1, 2)

    def at(self, step: int) -> Presence:
        """Those that are there at the time number `step`."""
        mover = np.flatnonzero(self.there[:, step])
        x, y, yaw, speed, yaw_rate = self.states[mover, :, step].T
        return Presence(mover, x, y, yaw, speed, yaw_rate, self.size[mover, 0], self.size[mover, 1])
