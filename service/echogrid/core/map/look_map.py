"""The default map: what a network said is averaged over looks, beside a layer of plain geometry; both are read out together.

A learned model says its prior anew each time it is asked. Summed as if the answers were independent (Eq. 1 of the paper), they saturate;
their mean does not. Reason and figures: docs/fusion.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.map.footprint import Footprint
from echogrid.core.map.occupancy import add_clamped
from echogrid.core.map.tile import Layers
from echogrid.core.map.tiled_map import LogOdds, TiledMap, View
from echogrid.core.motion.se2 import SE2

STEP, TURN = 0.5, math.radians(3.0)  # m and rad of ego motion after which a new look begins
UPDATES = 4  # of a look that count; a standing car learns nothing new
MOST_LOOKS = 20.0  # the mean forgets what is older
SURE, RESERVE = 1.5, 1.0  # RESERVE looks of -SURE (p = 0.18) are mixed into what reads less: surely free takes more than one look
HIT = 0.4  # log-odds of geometry above which a cell is a measured hit; less is a trace, a beam's edge or a hit that rays passed since
DOUBT, LEAST_DOUBT = 0.5, 0.3  # a hit is worth log-odds of at least -DOUBT, rising to -LEAST_DOUBT as geometry nears its clamp
KNOWN = 0.5  # how much of its looks a network must hold a cell for observable before it is told of


@dataclass(frozen=True, slots=True)
class Calibration:
    """log-odds = learned * (mean of the network's log-odds) + offset."""

    learned: float = 1.0
    offset: float = 0.0


class LookMap(TiledMap):
    """Layers: the weighted sum of the network's log-odds, its weights, the looks (all three as they fade), and the geometry's log-odds."""

    layers = 4

    def __init__(self, spec: GridSpec, calibration: Calibration, clamp: float = 3.5, max_tiles: int = 4096) -> None:
        super().__init__(spec, clamp, max_tiles)
        self.calibration = calibration
        self._begun: SE2 | None = None  # pose of the running look's first update
        self._updates = 0  # of the running look

    def clear(self) -> None:
        super().clear()
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
        self._updates += 1
        return self._updates <= UPDATES

    def integrate(self, said: Image, odom_from_base: SE2, view: View | None = None) -> None:
        """Adds (3, H, W): the network's log-odds, the weight of its answer (0 … 1), and the geometry's log-odds.

        An update is 1 / UPDATES of a look, so that a slow car's looks count no more than a fast one's.
        """
        log_odds, weight, geometric = said
        look = np.full_like(weight, 1.0 / UPDATES)
        planes = np.stack((log_odds * weight * look, weight * look, look, geometric))
        footprint = Footprint.of(odom_from_base, self.spec)
        patch = footprint.bilinear(planes)
        for layers, inside, piece in self._changing(footprint, view):
            mean = layers[:3, *inside]
            mean += patch[:3, *piece]
            mean *= np.minimum(1.0, MOST_LOOKS / np.maximum(mean[2], 1.0))  # forgets evenly once there are more
            add_clamped(layers[3], inside, patch[3, *piece], self.clamp)

    def read(self, layers: Layers) -> LogOdds:
        """The calibrated mean; few looks make nothing surely free, nor does a trace, and a hit may be doubted, not denied."""
        total, weight, looks, geometric = layers
        known = (weight >= KNOWN * looks) & (looks > 0) | (geometric != 0)
        mean = total / np.maximum(weight, np.float32(1e-6))
        log_odds = np.float32(self.calibration.learned) * mean + np.float32(self.calibration.offset)
        reserved = (log_odds * weight - np.float32(SURE * RESERVE)) / (weight + np.float32(RESERVE))
        log_odds = np.where(log_odds < -SURE, reserved, log_odds)
        hit = np.float32(-DOUBT) + np.float32((DOUBT - LEAST_DOUBT) / self.clamp) * geometric
        least = np.where(geometric > HIT, hit, np.float32(-SURE))
        log_odds = np.where((geometric > 0) & (log_odds < least), least, log_odds)
        log_odds[log_odds == 0] = np.finfo(np.float32).tiny
        return np.where(known, log_odds, np.float32(0))

    def measured(self, layers: Layers) -> NDArray[np.bool_]:
        return np.asarray(layers[3] != 0)
