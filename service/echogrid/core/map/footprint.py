"""Where the map's cells around the car lie in the patch around it: both are squares of cells, turned against each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

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
    lies: tuple[Layers, Layers, float, float, float]  # as the loops have it, see kernels/tiles.py: dx (W,), dy (H,), cosine, sine, shift

    @staticmethod
    def of(odom_from_base: SE2, spec: GridSpec) -> Footprint:
        """Around a pose."""
        cell, half = spec.cell, spec.half
        cos, sin = math.cos(odom_from_base.yaw), math.sin(odom_from_base.yaw)
        reach = (half + cell / 2) * (abs(cos) + abs(sin))
        column = math.floor((odom_from_base.x - reach) / cell)
        row = math.floor((odom_from_base.y - reach) / cell)
        # From the car, in cells: small enough for float32, which halves the time.
        centres = np.arange(0.5, math.ceil(2 * reach / cell) + 1) + np.array(((column,), (row,)))
        centres *= cell
        centres -= ((odom_from_base.x,), (odom_from_base.y,))
        centres /= cell
        dx, dy = centres.astype(np.float32)
        return Footprint(row, column, (dx, dy, cos, sin, half / cell + 0.5))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the map's cells."""
        return len(self.lies[1]), len(self.lies[0])

    def bilinear(self, planes: Layers) -> Layers:
        """Planes (P, H, W) of the patch on the map's cells, (P, height, width)."""
        out = np.empty((len(planes), *self.shape), dtype=np.float32)
        loops.bilinear(np.ascontiguousarray(planes, dtype=np.float32), *self.lies, out)
        return out
