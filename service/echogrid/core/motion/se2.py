"""Rigid transforms of the plane, named `a_from_b` so that they cancel by eye."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops

Points = NDArray[np.float64]
_new = tuple.__new__  # as a NamedTuple's own does, one call sooner: poses are made all the time


class SE2(NamedTuple):
    """`a_from_b`: the pose of frame b in frame a. Metres and radians, x forward, y left, yaw counter-clockwise (ISO 8855)."""

    x: float
    y: float
    yaw: float

    def __matmul__(self, other: SE2) -> SE2:
        """`a_from_c = a_from_b @ b_from_c`; yaw is added, not wrapped, so that a trajectory's yaw is continuous."""
        x, y, yaw = self
        to_x, to_y, turn = other
        c, s = math.cos(yaw), math.sin(yaw)
        return _new(SE2, (x + c * to_x - s * to_y, y + s * to_x + c * to_y, yaw + turn))

    def ahead(self, distance: float, turn: float) -> SE2:
        """`self @ arc(distance, turn)`, which is asked for most often."""
        x, y, yaw = self
        if -1e-4 < turn < 1e-4:  # there, sin(t)/t and (1 - cos t)/t lose digits; the next terms are under 1e-17
            along, aside = distance * (1.0 - turn * turn / 6.0), distance * turn / 2.0 * (1.0 - turn * turn / 12.0)
        else:
            radius = distance / turn
            along, aside = radius * math.sin(turn), radius * (1.0 - math.cos(turn))
        c, s = math.cos(yaw), math.sin(yaw)
        return _new(SE2, (x + c * along - s * aside, y + s * along + c * aside, yaw + turn))

    def inverse(self) -> SE2:
        """`b_from_a`."""
        x, y, yaw = self
        c, s = math.cos(yaw), math.sin(yaw)
        return _new(SE2, (-c * x - s * y, s * x - c * y, -yaw))

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
    return IDENTITY.ahead(distance, turn)
