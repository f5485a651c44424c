"""Where the map's cells around the car lie in the patch around it: both are squares of cells, turned against each other."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.kernels.dispatch import loops
from echogrid.core.map.tile import Layers
from echogrid.core.motion.se2 import SE2


class Footprint(msgspec.Struct, frozen=True, eq=False):
    """Each cell reads the patch at its own centre, so that a turn neither doubles nor loses anything; outside the patch it reads 0."""

    lies: tuple[int, int, int, int, float, float, float, float, float, float]  # as the loops have it, see kernels/tiles.py

    @staticmethod
    def of(odom_from_base: SE2, spec: GridSpec) -> Footprint:
        """Around a pose."""
        cell, half = spec.cell, spec.half
        x, y, yaw = odom_from_base
        cos, sin = math.cos(yaw), math.sin(yaw)
        reach = (half + cell / 2) * (abs(cos) + abs(sin))
        size = math.ceil(2 * reach / cell) + 1
        row, column = math.floor((y - reach) / cell), math.floor((x - reach) / cell)
        return Footprint((row, column, size, size, cell, x, y, cos, sin, half / cell + 0.5))

    @property
    def row(self) -> int:
        """Of the map's first cell around the car."""
        return self.lies[0]

    @property
    def column(self) -> int:
        """Of the same."""
        return self.lies[1]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the map's cells."""
        return self.lies[2], self.lies[3]

    def bilinear(self, planes: Layers) -> Layers:
        """Planes (P, H, W) of the patch on the map's cells, (P, height, width)."""
        out = np.empty((len(planes), *self.shape), dtype=np.float32)
        loops.bilinear(np.ascontiguousarray(planes, dtype=np.float32), *self.lies, out)
        return out
