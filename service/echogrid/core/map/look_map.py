"""The default map: what a network says, averaged over looks, beside what the radars measured; both are read out together.

A learned model repeats its prior each time it is asked. Summed as if the answers were independent (Eq. 1 of the paper), they saturate;
their mean does not. What was measured is counted, and decides wherever there is enough of it. Reason and figures: docs/fusion.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.beams import Beams
from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.kernels.dispatch import loops
from echogrid.core.map.footprint import Footprint
from echogrid.core.map.measurement import GONE, REACH, Change, Measurement
from echogrid.core.map.read_out import RULE, read_out
from echogrid.core.map.tile import SIDE, Layers, Tile
from echogrid.core.map.tiled_map import LogOdds, TiledMap, View
from echogrid.core.motion.se2 import SE2

STEP, TURN = 0.5, math.radians(3.0)  # m and rad of ego motion after which a new look begins
UPDATES = 4  # of a look that count; a standing car learns nothing new
MOST_LOOKS = 20.0  # the mean forgets what is older
MOST_MEASURED = 60.0  # looks that measured a cell; what is older fades


@dataclass(frozen=True, slots=True)
class Calibration:
    """log-odds = learned * (mean of the network's log-odds) + offset."""

    learned: float = 1.0
    offset: float = 0.0


class LookMap(TiledMap):
    """Layers: the weighted sum of the network's log-odds, its weights; looks with a reflection in the cell, the same beside it weighted by
    distance, looks in which a beam passed. All fade as newer ones come."""

    layers = 5
    reach = REACH

    def __init__(
        self, spec: GridSpec, calibration: Calibration, clamp: float = 3.5, max_tiles: int = 4096, beam: BeamModel | None = None
    ) -> None:
        super().__init__(spec, clamp, max_tiles)
        self.calibration = calibration
        self._measurement = Measurement(spec.cell, beam or BeamModel())
        self._begun: SE2 | None = None  # pose of the running look's first update
        self._updates = 0  # of the running look

    def clear(self, begun_ns: int) -> None:
        super().clear(begun_ns)
        self._begun, self._updates = None, 0

    def takes(self, odom_from_base: SE2) -> bool:
        """True for the first UPDATES updates after every STEP of way or TURN."""
        begun = self._begun
        if (
            begun is None
            or math.hypot(odom_from_base.x - begun.x, odom_from_base.y - begun.y) >= STEP
            or abs(odom_from_base.yaw - begun.yaw) >= TURN
        ):
            self._begun, self._updates = odom_from_base, 0
            self._measurement.begin(odom_from_base)
        self._updates += 1
        return self._updates <= UPDATES

    def measure(self, beams: Beams, odom_from_base: SE2, view: View) -> None:
        """Counts what the first UPDATES updates of a look measured; after them, what arrives and what leaves while the car stands."""
        if self._updates <= UPDATES:
            self._add(self._measurement.look(beams), view.stamp_ns)
            return
        seconds = (view.stamp_ns - self.stamp_ns) * 1e-9
        self._changing(Footprint.of(odom_from_base, self.spec), view)  # in view, and compared with what is usual
        self._add(self._measurement.stand(beams, seconds), view.stamp_ns)

    def integrate(self, said: Image, odom_from_base: SE2, view: View | None = None) -> None:
        """Adds (2, H, W): the network's log-odds and the weight of its answer (0 … 1).

        An update is 1 / UPDATES of a look, so that a slow car's looks count no more than a fast one's.
        """
        footprint = Footprint.of(odom_from_base, self.spec)
        under, tiles = self._changing(footprint, view)
        loops.add_looks(said, 1 / UPDATES, *footprint.lies, MOST_LOOKS, under, [tile.layers for tile in tiles])

    def read(self, layers: Layers) -> LogOdds:
        """What was learned and what was measured together, as docs/fusion.md says."""
        return read_out(layers, self.calibration.learned, self.calibration.offset)

    def read_tiles(self, keys: NDArray[np.int64], tiles: Sequence[Tile], row: int, column: int, out: LogOdds) -> None:
        said = self.calibration
        loops.read_out(row, column, keys * SIDE, [tile.layers for tile in tiles], said.learned, said.offset, RULE, out)

    def learned(self, layers: Layers) -> LogOdds:
        """(H, W): the calibrated mean of what the network said alone; 0 where it said nothing."""
        total, weight = layers[:2]
        mean = total / np.maximum(weight, np.float32(1e-6))
        log_odds = np.float32(self.calibration.learned) * mean + np.float32(self.calibration.offset)
        return np.where(weight > 0, log_odds, np.float32(0))

    def measured(self, layers: Layers) -> NDArray[np.bool_]:
        return np.asarray(layers[2:].any(axis=0))

    def _add(self, change: Change, stamp_ns: int) -> None:
        self.stamp_ns = stamp_ns
        begins, keys = change.touched()
        tiles = self._changed(keys)
        loops.add_measured(
            begins,
            change.inside,
            change.hits,
            change.near,
            change.passes,
            change.arrived,
            change.left,
            change.radars,
            self._now_s(),
            GONE,
            MOST_MEASURED,
            [tile.layers for tile in tiles],
            [tile.radars for tile in tiles],
            [tile.seen_s for tile in tiles],
        )
