"""The paper's map: each patch of log-odds added where the car was (its Eq. 1)."""

from __future__ import annotations

import numpy as np

from echogrid.core.raster import GridSpec, Image
from echogrid.core.se2 import SE2
from echogrid.core.tiled_map import Layers, LogOdds, TiledMap, resample


class OccupancyMap(TiledMap):
    """One layer, the sum of log-odds. A cell whose evidence cancels exactly is kept as the smallest positive number."""

    layers = 1

    def __init__(self, spec: GridSpec, clamp: float = 3.5, max_tiles: int = 4096) -> None:
        super().__init__(spec, max_tiles)
        self.clamp = clamp

    def takes(self, odom_from_base: SE2) -> bool:
        return True

    def integrate(self, said: Image, odom_from_base: SE2) -> None:
        """Adds a patch (H, W) of log-odds around the car: logit(m|z_0:t) = logit(m|z_t) + logit(m|z_0:t-1), then clamps."""
        row, column, (patch,) = resample(said[None], odom_from_base, self.spec)
        for tile, inside, piece in self._pieces(row, column, *patch.shape, create=True):
            add_clamped(tile[0], inside, patch[piece], self.clamp)
        self._forget(odom_from_base)

    def read(self, layers: Layers) -> LogOdds:
        (log_odds,) = layers
        return np.asarray(log_odds)


def add_clamped(layer: LogOdds, where: tuple[slice, slice], added: LogOdds, clamp: float) -> None:
    """Adds log-odds in place, within +-clamp; 0 stays for what was never seen."""
    total = np.clip(layer[where] + added, -clamp, clamp)
    layer[where] = np.where((added != 0) & (total == 0), np.finfo(np.float32).tiny, total)
