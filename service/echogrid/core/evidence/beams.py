"""Beams of static detections in the map: where a reflection may lie, and what was passed on the way."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.cells import window_cells
from echogrid.core.messages import Floats

Cells = NDArray[np.int64]


class Beams(msgspec.Struct, frozen=True, eq=False):
    """Static detections of one update in odom, as far as the radars see."""

    points: Floats  # (N, 2) m
    origins: Floats  # (N, 2) m, of the radars that measured them
    radars: NDArray[np.uint16]  # (N,) the bit of that radar, 1 << i for the i-th one


class Window(msgspec.Struct, frozen=True):
    """A square of the map's cells; `row` and `column` of its first cell in the map."""

    row: int
    column: int
    size: int
    cell: float  # m

    def flat(self, points: Floats) -> Cells:
        """Flat index (…,) of points (…, 2) in odom; -1 for those outside."""
        return window_cells(points, self.row, self.column, self.size, self.cell)


class Reach(msgspec.Struct, frozen=True, eq=False):
    """How far beams go, and which way their rays, over +-2 sigma of azimuth."""

    distance: Floats  # (N,) m
    cos: Floats  # (N, rays) of the rays' bearings in odom
    sin: Floats  # (N, rays)
    shares: Floats  # (rays,) of a detection

    @staticmethod
    def of(beams: Beams, sigmas: Floats, shares: Floats, sigma: float) -> Reach:
        """Of each of the beams, with rays as `BeamModel.spread` has them; `sigma`: rad, of the azimuth."""
        away = beams.points - beams.origins
        bearing = np.arctan2(away[:, 1], away[:, 0])[:, None] + sigmas * sigma  # (N, rays)
        return Reach(np.hypot(away[:, 0], away[:, 1]), np.cos(bearing), np.sin(bearing), shares)

    def ends(self, beams: Beams) -> Floats:
        """(N, rays, 2) m in odom: where the reflections may lie."""
        rays = np.stack((self.cos, self.sin), axis=-1)
        found: Floats = rays * self.distance[:, None, None] + beams.origins[:, None]
        return found
