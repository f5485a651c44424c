"""Where the map's cells around the car lie in the patch around it: both are squares of cells, turned against each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.tile import Layers
from echogrid.core.motion.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """`row` and `column`: of the map's first cell around the car. Each cell reads the patch at its own centre, so that a turn neither
    doubles nor loses anything; outside the patch it reads 0."""

    row: int
    column: int
    _across: int  # cells along a side of the patch with its border of one zero cell
    _flat: NDArray[np.intp]  # (H, W) place in that patch of the cell to the lower left; 0 outside
    _fu: Layers  # (H, W) how far on from that cell's centre, along x and y
    _fv: Layers
    _outside: NDArray[np.bool_]  # (H, W)

    @staticmethod
    def of(odom_from_base: SE2, spec: GridSpec) -> Footprint:
        """Around a pose."""
        cell, half = spec.cell, spec.half
        reach = (half + cell / 2) * (abs(np.cos(odom_from_base.yaw)) + abs(np.sin(odom_from_base.yaw)))
        column = int(np.floor((odom_from_base.x - reach) / cell))
        row = int(np.floor((odom_from_base.y - reach) / cell))
        size = int(np.ceil(2 * reach / cell)) + 1
        c, s = np.cos(odom_from_base.yaw), np.sin(odom_from_base.yaw)
        # From the car, in cells: small enough for float32, which halves the time.
        dx = (((column + np.arange(size) + 0.5) * cell - odom_from_base.x) / cell).astype(np.float32)
        dy = (((row + np.arange(size) + 0.5) * cell - odom_from_base.y) / cell).astype(np.float32)[:, None]
        # Patch coordinates in cells, shifted by the half cell to the centres and by the border of one zero cell.
        c, s, shift = np.float32(c), np.float32(s), np.float32(half / cell + 0.5)
        u = c * dx + s * dy + shift
        v = c * dy - s * dx + shift
        limit = spec.cells  # with the border there are cells + 2 entries: 0 … cells + 1
        outside = (u < 0) | (v < 0) | (u >= limit + 1) | (v >= limit + 1)
        u0, v0 = np.floor(u), np.floor(v)
        flat = np.where(outside, 0, v0 * (limit + 2) + u0).astype(np.intp)
        return Footprint(row, column, limit + 2, flat, u - u0, v - v0, outside)

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows and columns of the map's cells."""
        return self._flat.shape

    def bilinear(self, planes: Layers) -> Layers:
        """Planes (P, H, W) of the patch on the map's cells, (P, height, width)."""
        out = np.empty((len(planes), *self.shape), dtype=np.float32)
        flat, fu, fv = self._flat, self._fu, self._fv
        for plane, values in zip(out, np.pad(planes, ((0, 0), (1, 1), (1, 1))).reshape(len(planes), -1), strict=True):
            below = values[flat] * (1 - fu) + values[flat + 1] * fu
            above = values[flat + self._across] * (1 - fu) + values[flat + self._across + 1] * fu
            plane[:] = np.where(self._outside, np.float32(0), below * (1 - fv) + above * fv)
        return out

    def nearest(self, bits: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Bits (H, W) of the patch on the map's cells, (height, width): those of the cell whose centre is nearest."""
        place = self._flat + (self._fu >= 0.5) + np.where(self._fv >= 0.5, self._across, 0)
        found: NDArray[np.uint16] = np.pad(bits, 1).reshape(-1)[place]
        found[self._outside] = 0
        return found
