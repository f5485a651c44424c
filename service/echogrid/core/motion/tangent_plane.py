"""Latitude and longitude on a plane: metres east and north of an origin, on the ellipsoid WGS 84."""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.messages import Floats

SEMI_MAJOR, FLATTENING = 6378137.0, 1.0 / 298.257223563  # m; WGS 84


class TangentPlane:
    """Touches the ellipsoid at an origin (rad): x east, y north there. Heights are left out; 10 km away that costs millimetres."""

    def __init__(self, latitude: float, longitude: float) -> None:
        self._origin = _on_ellipsoid(latitude, longitude)
        self._axes = _east_north(latitude, longitude)

    def place(self, latitude: float, longitude: float) -> tuple[float, float]:
        """m east and north of the origin, of a place (rad)."""
        east, north = self._axes @ (_on_ellipsoid(latitude, longitude) - self._origin)
        return float(east), float(north)

    def yaw(self, latitude: float, longitude: float, yaw: float) -> float:
        """rad counter-clockwise from the plane's x, of a yaw that is counter-clockwise from the east of that place: meridians converge."""
        ahead = np.array((math.cos(yaw), math.sin(yaw))) @ _east_north(latitude, longitude)
        east, north = self._axes @ ahead
        return math.atan2(north, east)


def _on_ellipsoid(latitude: float, longitude: float) -> Floats:
    """(3,) m from the earth's centre, at height 0."""
    squared = FLATTENING * (2.0 - FLATTENING)
    normal = SEMI_MAJOR / math.sqrt(1.0 - squared * math.sin(latitude) ** 2)
    outwards = np.array((math.cos(latitude) * math.cos(longitude), math.cos(latitude) * math.sin(longitude), math.sin(latitude)))
    return normal * outwards * (1.0, 1.0, 1.0 - squared)


def _east_north(latitude: float, longitude: float) -> Floats:
    """(2, 3) unit vectors there."""
    east = (-math.sin(longitude), math.cos(longitude), 0.0)
    return np.array((east, (-math.sin(latitude) * math.cos(longitude), -math.sin(latitude) * math.sin(longitude), math.cos(latitude))))
