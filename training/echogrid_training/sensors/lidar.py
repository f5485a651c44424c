"""A roof-mounted lidar with 32 beams, and the reduction of its points to one range per direction.

A turn is taken at one moment: the car's motion during it is not simulated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.sensors.visibility import Indices, crossings

BEAMS = np.radians(np.linspace(-30.67, 10.67, 32))  # of an HDL-32E, rad above the horizontal
AZIMUTHS = 1080
RATE = 10.0  # turns per second
BASE_FROM_LIDAR = SE2(1.35, 0.0, 0.0)
HEIGHT = 1.9  # m above the ground
MAX_RANGE = 70.0  # m
GROUND = 0.3  # m: lower points are ground; kerbs are
ROOF = 1.8  # m: higher points are overhead


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """Vertical surfaces: segments (S, 2, 2) m from `bottom` to `top` (S,) m above the ground."""

    segments: Floats
    bottom: Floats
    top: Floats

    def pick(self, index: Indices) -> Surfaces:
        """Some of them."""
        return Surfaces(self.segments[index], self.bottom[index], self.top[index])

    def __add__(self, other: Surfaces) -> Surfaces:
        pieces = ((getattr(self, name), getattr(other, name)) for name in ("segments", "bottom", "top"))
        return Surfaces(*(np.concatenate(pair) for pair in pieces))


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """One turn's returns by azimuth (world frame, bearings()) and beam: horizontal distance, height and surface."""

    distance: Floats  # (AZIMUTHS, beams) m, inf where nothing came back
    height: Floats  # (AZIMUTHS, beams) m
    surface: Indices  # (AZIMUTHS, beams), -1 for the ground and where nothing came back


def bearings() -> Floats:
    """(AZIMUTHS,) rad in the world, increasing from 0."""
    return np.linspace(0.0, 2 * np.pi, AZIMUTHS, endpoint=False)


def turn(surfaces: Surfaces, origin: Floats) -> Turn:
    """What comes back to the lidar at `origin` (2,) m: each beam's first surface, or the ground before it."""
    found = crossings(surfaces.segments, origin, bearings())
    reached = np.flatnonzero(found.distance < MAX_RANGE)
    order = reached[np.lexsort((found.distance[reached], found.ray[reached]))]
    ray, segment, distance = found.ray[order], found.segment[order], found.distance[order]

    slopes = np.tan(BEAMS)
    heights = HEIGHT + distance[:, None] * slopes  # (P, beams)
    met = (heights >= surfaces.bottom[segment, None]) & (heights <= surfaces.top[segment, None])
    nearest = np.full((AZIMUTHS, len(BEAMS)), len(order), dtype=np.int32)  # rows are in order of distance, so the lowest number is nearest
    starts = np.flatnonzero(np.diff(ray, prepend=-1))
    if len(starts):
        numbers = np.arange(len(order), dtype=np.int32)[:, None]
        nearest[ray[starts]] = np.minimum.reduceat(np.where(met, numbers, np.int32(len(order))), starts, axis=0)
    surface_distance = np.append(distance, np.inf)[nearest]
    with np.errstate(divide="ignore"):
        ground = np.where(slopes < 0, -HEIGHT / slopes, np.inf)
    ground = np.where(ground < MAX_RANGE, ground, np.inf)
    grounded = ground <= surface_distance
    distance_out = np.where(grounded, ground, surface_distance)
    surface = np.where(grounded, -1, np.append(segment, -1)[nearest])
    height = np.where(grounded, 0.0, HEIGHT + np.where(np.isfinite(surface_distance), surface_distance, 0.0) * slopes)
    return Turn(distance_out, height, surface)


def reduce(points: Turn) -> tuple[Floats, Indices]:
    """The nearest return of each azimuth (AZIMUTHS,), m, without ground and overhead, and its surface; inf and -1 where there is none."""
    standing: NDArray[np.bool_] = (points.height > GROUND) & (points.height < ROOF)
    distance = np.where(standing, points.distance, np.inf)
    nearest = distance.argmin(axis=1)
    rows = np.arange(AZIMUTHS)
    found = distance[rows, nearest]
    return found, np.where(np.isfinite(found), points.surface[rows, nearest], -1)
