"""The analytic inverse sensor model (Elfes 1989) with the network's signature: a radar image in, log-odds out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echogrid.core.mount import Mount
from echogrid.core.raster import GridSpec, Image


@dataclass(frozen=True, slots=True)
class BeamModel:
    """What one detection says about the cells of its beam. Log-odds per detection; angles in radians."""

    occupied: float = 1.2  # spread over the cells where the reflection may lie
    free: float = -0.12  # of each cell that a ray passes
    beam_sigma: float = 0.026  # rad, of the azimuth
    rays: int = 5  # over +-2 sigma
    margin: float = 1.0  # cells before the detection that the ray says nothing about


class AnalyticSensorModel:
    """Callable (1, H, W) image in [-1, 1] -> (H, W) log-odds, 0 where it says nothing.

    A radar image does not say which radar saw what, so each cell's beam comes from the nearest radar that has it in view. Mounts
    and grid are fixed: what a detection in a cell says about all cells is worked out once and kept as a sparse table.
    """

    def __init__(self, spec: GridSpec, mounts: Sequence[Mount], beam: BeamModel | None = None) -> None:
        self.spec = spec
        beam = beam or BeamModel()
        tables = [_beam(cell, spec, mounts, beam) for cell in spec.centres().reshape(-1, 2)]
        self._start = np.concatenate(([0], np.cumsum([len(cells) for cells, _ in tables])))  # (H*W + 1,)
        self._cells = np.concatenate([cells for cells, _ in tables]).astype(np.int32)
        self._log_odds = np.concatenate([log_odds for _, log_odds in tables]).astype(np.float32)

    def __call__(self, image: Image) -> Image:
        """Sum of what every drawn detection says."""
        drawn = np.flatnonzero(image[0].reshape(-1) > 0)
        starts, lengths = self._start[drawn], np.diff(self._start)[drawn]
        # Positions of all entries of all drawn cells: a range per cell, end to end.
        entries = np.arange(lengths.sum()) + np.repeat(starts - np.cumsum(lengths) + lengths, lengths)
        size = self.spec.cells**2
        total = np.bincount(self._cells[entries], weights=self._log_odds[entries], minlength=size)
        return total.astype(np.float32).reshape(self.spec.cells, self.spec.cells)


def _beam(
    cell: np.ndarray, spec: GridSpec, mounts: Sequence[Mount], beam: BeamModel
) -> tuple[np.ndarray, np.ndarray]:
    """Flat cell indices and log-odds that a detection in the middle of `cell` (x, y in base) adds."""
    seen_from = [mount.base_from_sensor for mount in mounts if mount.sees(cell)]
    if not seen_from:
        return np.empty(0, dtype=np.int64), np.empty(0)
    sensor = min(seen_from, key=lambda pose: np.hypot(cell[0] - pose.x, cell[1] - pose.y))
    dx, dy = cell[0] - sensor.x, cell[1] - sensor.y
    distance, bearing = np.hypot(dx, dy), np.arctan2(dy, dx)
    offsets = np.linspace(-2, 2, beam.rays)
    weights = np.exp(-(offsets**2) / 2)
    size = spec.cells**2
    log_odds = np.zeros(size)
    steps = np.arange(spec.cell / 2, distance - beam.margin * spec.cell, spec.cell / 2)
    for offset, weight in zip(offsets, weights / weights.sum(), strict=True):
        direction = np.array((np.cos(bearing + offset * beam.beam_sigma), np.sin(bearing + offset * beam.beam_sigma)))
        origin = (sensor.x, sensor.y)
        passed = np.unique(spec.index(origin + steps[:, None] * direction))
        log_odds[passed] += beam.free * weight * beam.rays / 2
        hit = spec.index((origin + distance * direction)[None])
        log_odds[hit] += beam.occupied * weight
    cells = np.flatnonzero(log_odds)
    return cells, log_odds[cells]
