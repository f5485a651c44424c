"""Where a drive needs room, and what stands in it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from echogrid.config.tables import Body
from echogrid.core.messages import Floats
from echogrid_training.towns.town import Mover, Track

ROOM = 0.35  # m between a car and whatever stands


def corners(x: Floats, y: Floats, yaw: Floats, ahead: float, behind: float, width: float) -> Floats:
    """(N, 4, 2) m: rectangles from `behind` m behind these poses to `ahead` m before them."""
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    long = np.array((ahead, -behind, -behind, ahead))
    wide = np.array((width, width, -width, -width)) / 2
    return np.stack((x[:, None] + c * long - s * wide, y[:, None] + s * long + c * wide), axis=-1)


def ego_corners(track: Track, body: Body) -> Floats:
    """(T, 4, 2) m of the ego's outline at each of the track's times."""
    return corners(track.x, track.y, track.yaw, body.length - body.rear_overhang, body.rear_overhang, body.width)


def mover_corners(mover: Mover) -> Floats:
    """(T, 4, 2) m of a mover's outline at each of its track's times."""
    track = mover.track
    return corners(track.x, track.y, track.yaw, mover.length / 2, mover.length / 2, mover.width)


def swept(outlines: Floats, step: float = 0.2) -> NDArray[np.object_]:
    """Polygons that cover what outlines (T, 4, 2) pass over, one every `step` m of travel."""
    middle = outlines.mean(axis=1)
    # A turn on the spot moves the corners, not the middle, but cars cannot do that.
    walked = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(middle, axis=0).T))))
    kept = np.searchsorted(walked, np.arange(0.0, walked[-1] + step, step))
    kept = np.unique(np.minimum(kept, len(walked) - 1))
    polygons: NDArray[np.object_] = shapely.polygons(outlines[kept])
    return polygons


def in_the_way(shapes: Sequence[shapely.Geometry], sweep: NDArray[np.object_], room: float = ROOM) -> NDArray[np.bool_]:
    """(N,) whether each of the shapes comes closer than `room` m to a sweep."""
    found = np.zeros(len(shapes), dtype=bool)
    if len(shapes) and len(sweep):
        hits, _ = shapely.STRtree(sweep).query(np.array(shapes, dtype=object), predicate="dwithin", distance=room)
        found[hits] = True
    return found


def overlapping(ours: Floats, theirs: Floats, room: float = 0.0) -> NDArray[np.bool_]:
    """(T,) whether two moving rectangles (T, 4, 2), corners in order, come closer than about `room` m, time by time.

    By separating axes: apart if along a side of either all corners of one lie beyond those of the other.
    """
    diagonals = sum(np.hypot(*(boxes[0, 2] - boxes[0, 0])) for boxes in (ours, theirs))
    between = (ours[:, 0] + ours[:, 2] - theirs[:, 0] - theirs[:, 2]) / 2  # of their centres
    near = np.hypot(between[:, 0], between[:, 1]) < diagonals / 2 + 2 * room
    ours, theirs = ours[near], theirs[near]
    apart = np.zeros(len(ours), dtype=bool)
    for one in (ours, theirs):
        for side in (0, 1):
            axis = one[:, side + 1] - one[:, side]
            axis = axis / np.hypot(axis[:, 0], axis[:, 1])[:, None]
            mine, other = (np.einsum("tcd,td->tc", box, axis) for box in (ours, theirs))
            gap = np.maximum(other.min(axis=1) - mine.max(axis=1), mine.min(axis=1) - other.max(axis=1))
            apart |= gap > room
    near[near] = ~apart
    found: NDArray[np.bool_] = near
    return found


def resampled(track: Track, rate: float) -> Track:
    """Every so many-th of the samples: `rate` times per second. The track's own rate is a multiple of it."""
    every = max(1, math.floor(0.5 + 1.0 / (rate * (track.time[1] - track.time[0]))))
    return Track(*(getattr(track, name)[::every] for name in ("time", "x", "y", "yaw", "speed", "yaw_rate")))
