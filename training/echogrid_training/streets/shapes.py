"""Plane geometry that towns are drawn with: lines to walk along and outlines to stand about. All lengths in m, all angles in rad."""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2


def distances(line: Floats) -> Floats:
    """(N,) m along a line (N, 2) from its start to each of its points."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))


def length(line: Floats) -> float:
    """Of a line (N, 2)."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def along(line: Floats, places: Floats) -> Floats:
    """Points (M, 2) at these distances (M,) m from the start of a line (N, 2); beyond its ends, the ends."""
    walked = distances(line)
    return np.stack((np.interp(places, walked, line[:, 0]), np.interp(places, walked, line[:, 1])), axis=-1)


def resample(line: Floats, step: float) -> Floats:
    """The line in equal steps of about `step` m, both ends kept; its corners are cut by less than a step."""
    total = length(line)
    return along(line, np.linspace(0.0, total, max(2, round(total / step) + 1)))


def part(line: Floats, start: float, end: float) -> Floats:
    """Of the line, what lies between two distances along it, with its corners."""
    walked = distances(line)
    inside = line[(walked > start + 1e-6) & (walked < end - 1e-6)]
    return np.concatenate((along(line, np.array([start])), inside, along(line, np.array([end]))))


def frame_at(line: Floats, place: float) -> SE2:
    """`town_from_place`: where the line is at that distance along it, x along the line."""
    walked = distances(line)
    side = int(np.clip(np.searchsorted(walked, place, side="right") - 1, 0, len(line) - 2))
    step = line[side + 1] - line[side]
    x, y = line[side] + step * np.clip((place - walked[side]) / max(walked[side + 1] - walked[side], 1e-9), 0.0, 1.0)
    return SE2(float(x), float(y), math.atan2(step[1], step[0]))


def directions(line: Floats) -> Floats:
    """(N, 2) unit vectors along the line at its points, at corners halfway between the sides'."""
    sides = np.diff(line, axis=0)
    sides = sides / np.maximum(np.hypot(*sides.T), 1e-9)[:, None]
    both = np.concatenate((sides[:1], sides[:-1] + sides[1:], sides[-1:]))
    middles: Floats = both / np.maximum(np.hypot(*both.T), 1e-9)[:, None]
    return middles


def offset(line: Floats, left: float | Floats) -> Floats:
    """The line moved to its left (negative: right) by so much, one value or one per point; sharp corners are blunted."""
    sides = np.diff(line, axis=0)
    sides = sides / np.maximum(np.hypot(*sides.T), 1e-9)[:, None]
    middle = directions(line)
    ahead = np.concatenate((sides, sides[-1:]))
    mitre = 1.0 / np.maximum((middle * ahead).sum(axis=1), 0.7)
    normals = np.stack((-middle[:, 1], middle[:, 0]), axis=-1)
    moved: Floats = line + normals * (mitre * left)[:, None]
    return moved


def smooth(line: Floats, reach: float, step: float = 0.5) -> Floats:
    """The line in steps of `step`, its corners rounded over about twice `reach` m; both ends stay."""
    fine = resample(line, step)
    half = max(1, round(3 * reach / step))
    if len(fine) < 3:
        return fine
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) * step / reach) ** 2)
    kernel /= kernel.sum()
    # Odd reflection about the ends keeps them and the directions there.
    index = np.arange(1, half + 1)
    before = 2 * fine[0] - fine[np.minimum(index, len(fine) - 1)][::-1]
    after = 2 * fine[-1] - fine[np.maximum(len(fine) - 1 - index, 0)]
    padded = np.concatenate((before, fine, after))
    return np.stack([np.convolve(padded[:, axis], kernel, mode="valid") for axis in (0, 1)], axis=-1)


def ramp(share: Floats) -> Floats:
    """From 0 to 1 without a kink as `share` goes from 0 to 1, constant outside."""
    held = np.clip(share, 0.0, 1.0)
    return held * held * (3.0 - 2.0 * held)


def rectangle(pose: SE2, ahead: float, width: float) -> Floats:
    """(4, 2) counter-clockwise: `ahead` m along x from the pose, `width` m across, half on each side of it."""
    return pose.apply(np.array(((0.0, -width / 2), (ahead, -width / 2), (ahead, width / 2), (0.0, width / 2))))


def box(pose: SE2, long: float, wide: float) -> Floats:
    """(4, 2) counter-clockwise, about the pose of its centre."""
    return rectangle(pose @ SE2(-long / 2, 0.0, 0.0), long, wide)


def body(pose: SE2, long: float, wide: float) -> Floats:
    """(12, 2) counter-clockwise, about the pose of its centre: a car seen from above, its corners rounded and its nose narrower."""
    x, y = long / 2, wide / 2
    half = np.array(((x, 0.55 * y), (x - 0.15, 0.8 * y), (x - 0.6, 0.98 * y), (-x + 0.5, y), (-x + 0.12, 0.88 * y), (-x, 0.65 * y)))
    return pose.apply(np.concatenate((half, half[::-1] * (1.0, -1.0))))


def disc(x: float, y: float, radius: float, corners: int = 8) -> Floats:
    """(corners, 2) counter-clockwise."""
    turn = np.arange(corners) * (2 * math.pi / corners)
    return np.stack((x + radius * np.cos(turn), y + radius * np.sin(turn)), axis=-1)
