"""Elfes' model with other beams and bounds than the service's: many at once over the same drive, so that the best can be chosen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.inverse_sensor_model import AnalyticSensorModel
from echogrid.core.evidence.raster import GridSpec, Image, rasterize
from echogrid.core.kernels.dispatch import loops
from echogrid.core.kernels.tiles import parts
from echogrid.core.map.footprint import Footprint
from echogrid.core.map.occupancy import LEAST, OccupancyMap
from echogrid.core.map.tile import Layers
from echogrid.core.map.tiled_map import LogOdds, View
from echogrid.core.motion.se2 import SE2
from echogrid_training.evaluation.simulated.baselines import Elfes
from echogrid_training.evaluation.simulated.tape import Tape
from echogrid_training.learning.dataset import SPEC


class BeamModels:
    """Callable: what each of some models says of the newest scans, (K, H, W) log-odds."""

    def __init__(self, tape: Tape, of: Sequence[Elfes]) -> None:
        mounts = tuple(tape.mounts.values())
        self._of = of
        self._models = {one.beam: AnalyticSensorModel(SPEC, mounts, one.beam) for one in of}

    def __call__(self, around: Surroundings) -> Image:
        image = rasterize(around.now.points, SPEC)
        said = {beam: model(image) for beam, model in self._models.items()}
        return np.stack([said[one.beam] for one in self._of])


class SummedBeams(OccupancyMap):
    """A layer a model: the sum of its log-odds within its own clamp, as if it were an OccupancyMap of its own."""

    def __init__(self, spec: GridSpec, of: Sequence[Elfes], max_tiles: int) -> None:
        super().__init__(spec, of[0].clamp, max_tiles)
        self.layers = len(of)
        self._clamps = [one.clamp for one in of]

    def integrate(self, said: Image, odom_from_base: SE2, view: View | None = None) -> None:
        """Adds (K, H, W) log-odds around the car."""
        footprint = Footprint.of(odom_from_base, self.spec)
        patch = footprint.bilinear(said)
        under, tiles = self._changing(footprint, view)
        for (inside, piece), tile in zip(parts(under, *footprint.lies[:4]), tiles, strict=True):
            for layer, added, clamp in zip(tile.layers, patch, self._clamps, strict=True):
                loops.add_clamped(added[piece], clamp, LEAST, layer[inside])

    def read(self, layers: Layers, into: LogOdds | None = None) -> LogOdds:
        """Of the first."""
        if into is None:
            return np.asarray(layers[0])
        into[:] = layers[0]
        return into
