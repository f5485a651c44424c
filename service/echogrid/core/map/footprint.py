"""Where the map's cells around the car lie in the patch around it: both are squares of cells, turned against each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.kernels.dispatch import loops
from echogrid.core.map.tile import Layers
from echogrid.core.motion.se2 import SE2


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """`row` and `column`: of the map's first cell around the car. Each cell reads the patch at its own centre, so that a turn neither
    doubles nor loses anything; outside the patch it reads 0."""

    row: int
    column: int
    _dx: Layers  # (W,) cells from the car to the map's cells, along odom's x
    _dy: Layers  # (H,) along its y
    _cos: float
    _sin: float
    _shift: float  # cells from the car to the first cell of the patch with a border of one zero cell, to the cells' centres

    @staticmethod
    def of(odom_from_base: SE2, spec: GridSpec) -> Footprint:
        """Around a pose."""
        cell, half = spec.cell, spec.half
        cos, sin = math.cos(odom_from_base.yaw), math.sin(odom_from_base.yaw)
        reach = (half + cell / 2) * (abs(cos) + abs(sin))
        column = math.floor((odom_from_base.x - reach) / cell)
        row = math.floor((odom_from_base.y - reach) / cell)
        centres = np.arange(math.ceil(2 * reach / cell) + 1) + 0.5
        # From the car, in cells: small enough for float32, which halves the time.
        dx = (((column + centres) * cell - odom_from_base.x) / cell).astype(np.float32)
        dy = (((row + centres) * cell - odom_from_base.y) / cell).astype(np.float32)
        return Footprint(row, column, dx, dy, cos, sin, half / cell + 0.5)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the map's cells."""
        return len(self._dy), len(self._dx)

    def bilinear(self, planes: Layers) -> Layers:
        """Planes (P, H, W) of the patch on the map's cells, (P, height, width)."""
        out = np.empty((len(planes), *self.shape), dtype=np.float32)
        loops.bilinear(np.ascontiguousarray(planes, dtype=np.float32), self._dx, self._dy, self._cos, self._sin, self._shift, out)
        return out

    def nearest(self, bits: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Bits (H, W) of the patch on the map's cells, (height, width): those of the cell whose centre is nearest."""
        out = np.empty(self.shape, dtype=np.uint16)
        loops.nearest(bits, self._dx, self._dy, self._cos, self._sin, self._shift, out)
        return out
