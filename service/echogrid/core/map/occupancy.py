"""The paper's map: each patch of log-odds added where the car was (its Eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import Image
from echogrid.core.kernels.dispatch import loops
from echogrid.core.kernels.tiles import parts
from echogrid.core.map.footprint import Footprint
from echogrid.core.map.tile import Layers, Tile
from echogrid.core.map.tiled_map import LogOdds, TiledMap, View
from echogrid.core.motion.se2 import SE2

LEAST = float(np.finfo(np.float32).tiny)  # of evidence that cancels: 0 is for what was never seen


class OccupancyMap(TiledMap):
    """One layer, the sum of log-odds. A cell whose evidence cancels exactly is kept as the smallest positive number."""

    layers = 1

    def takes(self, odom_from_base: SE2) -> bool:
        return True

    def integrate(self, said: Image, odom_from_base: SE2, view: View | None = None) -> None:
        """Adds a patch (H, W) of log-odds around the car: logit(m|z_0:t) = logit(m|z_t) + logit(m|z_0:t-1), then clamps."""
        footprint = Footprint.of(odom_from_base, self.spec)
        (patch,) = footprint.bilinear(said[None])
        under, tiles = self._changing(footprint, view)
        for (inside, piece), tile in zip(parts(under, *footprint.lies[:4]), tiles, strict=True):
            loops.add_clamped(patch[piece], self.clamp, LEAST, tile.layers[0][inside])

    def read(self, layers: Layers) -> LogOdds:
        return np.asarray(layers[0])

    def read_tiles(self, keys: NDArray[np.int64], tiles: Sequence[Tile], row: int, column: int, out: LogOdds) -> None:
        out[:] = 0
        for (inside, piece), tile in zip(parts(keys, row, column, *out.shape), tiles, strict=True):
            out[piece] = tile.layers[0][inside]

    def measured(self, layers: Layers) -> NDArray[np.bool_]:
        """All that is known: a sum does not tell what a network said from what geometry did."""
        return np.asarray(layers[0] != 0)
