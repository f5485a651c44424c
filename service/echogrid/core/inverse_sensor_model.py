"""The analytic inverse sensor model (Elfes 1989) with the network's signature: a radar image in, log-odds out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid.core.mount import Mount
from echogrid.core.raster import GridSpec, Image

Cells = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class BeamModel:
    """What one detection says about the cells of its beam: log-odds, spread over the rays by the azimuth's distribution."""

    occupied: float = 1.7  # all that is spread over the cells where the reflection may lie
    free: float = -0.12  # of a cell that the whole beam passes
    beam_sigma: float = 0.018  # rad, of the azimuth
    rays: int = 5  # over +-2 sigma
    margin: float = 2.0  # cells before the detection that the ray says nothing about


class AnalyticSensorModel:
    """Callable (1, H, W) image in [-1, 1] -> (H, W) log-odds, 0 where it says nothing.

    A radar image does not say which radar saw what, so each cell's beam comes from the nearest radar that has it in view. Mounts and
    grid are fixed: what a detection in a cell says about all cells is worked out when it is first seen there, and remembered.
    """

    def __init__(self, spec: GridSpec, mounts: Sequence[Mount], beam: BeamModel | None = None) -> None:
        self.spec = spec
        self.mounts = mounts
        self.beam = beam or BeamModel()
        self._said: dict[int, tuple[Cells, Image]] = {}  # flat cell of a detection -> flat cells and their log-odds

    def __call__(self, image: Image) -> Image:
        """Sum of what every drawn detection says."""
        shape = (self.spec.cells, self.spec.cells)
        drawn = np.flatnonzero(image[0].reshape(-1) > 0).tolist()
        if not drawn:
            return np.zeros(shape, dtype=np.float32)
        said = [self._said.get(cell) or self._say(cell) for cell in drawn]
        cells = np.concatenate([cells for cells, _ in said])
        log_odds = np.concatenate([log_odds for _, log_odds in said])
        return np.bincount(cells, weights=log_odds, minlength=image[0].size).astype(np.float32).reshape(shape)

    def _say(self, cell: int) -> tuple[Cells, Image]:
        """What a detection in the middle of a cell says, remembered."""
        row, column = divmod(cell, self.spec.cells)
        centre = (np.array((column, row)) + 0.5) * self.spec.cell - self.spec.half  # (x, y) in base
        seen_from = [mount.base_from_sensor for mount in self.mounts if mount.sees(centre)]
        if seen_from:
            origins = [np.array((pose.x, pose.y)) for pose in seen_from]
            log_odds = _beam(centre, min(origins, key=lambda origin: np.hypot(*(centre - origin))), self.spec, self.beam)
        else:
            log_odds = np.zeros(self.spec.cells**2)
        cells = np.flatnonzero(log_odds).astype(np.int32)
        self._said[cell] = cells, log_odds[cells].astype(np.float32)
        return self._said[cell]


def _beam(centre: Floats, origin: Floats, spec: GridSpec, beam: BeamModel) -> Floats:
    """(H * W,) log-odds of a detection at `centre` seen from `origin` (both (2,), base): free along the rays, occupied at their ends."""
    log_odds = np.zeros(spec.cells**2)
    distance, bearing = np.hypot(*(centre - origin)), np.arctan2(*(centre - origin)[::-1])
    sigmas = np.linspace(-2, 2, beam.rays)
    weights = np.exp(-(sigmas**2) / 2) / np.exp(-(sigmas**2) / 2).sum()
    steps = np.arange(spec.cell / 2, distance - beam.margin * spec.cell, spec.cell / 2)
    for angle, weight in zip(bearing + sigmas * beam.beam_sigma, weights, strict=True):
        direction = np.array((np.cos(angle), np.sin(angle)))
        log_odds[np.unique(spec.index(origin + steps[:, None] * direction))] += beam.free * weight
        log_odds[spec.index((origin + distance * direction)[None])] += beam.occupied * weight
    return log_odds
