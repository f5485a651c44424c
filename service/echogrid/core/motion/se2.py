"""Rigid transforms of the plane, named `a_from_b` so that they cancel by eye."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops

Points = NDArray[np.float64]


class SE2(NamedTuple):
    """`a_from_b`: the pose of frame b in frame a. Metres and radians, x forward, y left, yaw counter-clockwise (ISO 8855)."""

    x: float
    y: float
    yaw: float

    def __matmul__(self, other: SE2) -> SE2:
        """`a_from_c = a_from_b @ b_from_c`; yaw is added, not wrapped, so that a trajectory's yaw is continuous."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return SE2(self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y, self.yaw + other.yaw)

    def ahead(self, distance: float, turn: float) -> SE2:
        """`self @ arc(distance, turn)`, which is asked for most often."""
        x, y, yaw = self
        along, aside = _along(distance, turn)
        c, s = math.cos(yaw), math.sin(yaw)
        return SE2(x + c * along - s * aside, y + s * along + c * aside, yaw + turn)

    def inverse(self) -> SE2:
        """`b_from_a`."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return SE2(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)

    def apply(self, points_b: Points) -> Points:
        """Points (N, 2) from frame b into frame a."""
        points_a = np.empty((len(points_b), 2))
        loops.moved(np.ascontiguousarray(points_b, dtype=float), self.x, self.y, math.cos(self.yaw), math.sin(self.yaw), points_a)
        return points_a


IDENTITY = SE2(0.0, 0.0, 0.0)


def arc(distance: float, turn: float) -> SE2:
    """Motion along a circular arc of length `distance` (m) that turns by `turn` (rad).

    The exponential map of SE(2) for (distance, 0, turn), exact for constant speed and yaw rate. Near turn = 0 the series is
    used, so a straight line is not a special case.
    """
    return SE2(*_along(distance, turn), turn)


def _along(distance: float, turn: float) -> tuple[float, float]:
    """Where it ends."""
    if -1e-4 < turn < 1e-4:  # there, sin(t)/t and (1 - cos t)/t lose digits; the next terms are under 1e-17
        return distance * (1.0 - turn * turn / 6.0), distance * turn / 2.0 * (1.0 - turn * turn / 12.0)
    radius = distance / turn
    return radius * math.sin(turn), radius * (1.0 - math.cos(turn))
