"""One turn of a real lidar as the ideal inverse sensor model wants it: by bearing the nearest return that is neither ground nor car."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.config.tables import Body
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.sensors.lidar import AZIMUTHS, GROUND, ROOF, bearings
from echogrid_training.truth.ground_truth import REACH

OWN = 0.3  # m around the car's outline: what lies there is the car
MOVER = 2.5  # m around a detection that moves: what the lidar sees there moves


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """As TruthBuilder takes it."""

    origin: Floats  # (2,) m in odom
    ranges: Floats  # (AZIMUTHS,) m by bearing in odom; inf: free as far as the model reaches
    excluded: NDArray[np.bool_]  # (AZIMUTHS,) the range bounds what is free, and nothing stands there


def standing(points: Floats, height: Floats, body: Body) -> NDArray[np.bool_]:
    """(N,) of points (N, 3) m in base and their height (N,) m above the ground: neither ground nor overhead nor the car itself."""
    x, y = points.T[:2]
    front = body.length - body.rear_overhang
    own = (x > -body.rear_overhang - OWN) & (x < front + OWN) & (np.abs(y) < body.width / 2 + OWN)
    high: NDArray[np.bool_] = (height > GROUND) & (height < ROOF) & ~own
    return high


def reduce(points: Floats, height: Floats, place: Floats, odom_from_base: SE2, body: Body, moving: Floats) -> Reduced:
    """`points` (N, 3) m in base, their `height` (N,) m above the ground, `place` (2,) m of the lidar in base.

    `moving` (M, 2) m in odom: detections that moved at that time.
    """
    stands = standing(points, height, body)
    lidar = odom_from_base.apply(place[None])[0]
    flat = odom_from_base.apply(points[:, :2]) - lidar
    distance = np.hypot(flat[:, 0], flat[:, 1])
    ray = np.round(np.arctan2(flat[:, 1], flat[:, 0]) * (AZIMUTHS / (2 * np.pi))).astype(np.intp) % AZIMUTHS
    ranges = np.full(AZIMUTHS, np.inf)
    np.minimum.at(ranges, ray[stands], distance[stands])
    low = ~stands & (height <= GROUND)
    ground = np.zeros(AZIMUTHS)
    np.maximum.at(ground, ray[low], distance[low])
    unseen = np.isinf(ranges) & (ground == 0)  # nothing came back: a coarser lidar, or nobody knows
    bound = np.where(np.isfinite(ranges), ranges, ground)  # up to which a direction is known to be free
    grounded = np.isinf(ranges) & (ground < REACH) & ~unseen
    ranges = np.where(unseen, np.minimum(np.roll(bound, 1), np.roll(bound, -1)), np.where(grounded, ground, ranges))
    excluded = unseen | grounded
    if len(moving):
        known = np.flatnonzero(np.isfinite(ranges))
        bearing = bearings()[known]
        ends = lidar + ranges[known, None] * np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)
        excluded[known] |= (np.hypot(*(ends[:, None] - moving).transpose(2, 0, 1)) < MOVER).any(axis=1)
    return Reduced(lidar, ranges.astype(float), excluded)
