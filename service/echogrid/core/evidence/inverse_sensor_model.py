"""The analytic inverse sensor model (Elfes 1989) with the network's signature: a radar image in, log-odds out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.messages import Floats
from echogrid.core.radar.mount import Mount

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
        self.beam = beam or BeamModel()
        self._centres = spec.centres().reshape(-1, 2)
        self._origins = np.array([(mount.base_from_sensor.x, mount.base_from_sensor.y) for mount in mounts])
        distance = np.hypot(*(self._centres[None] - self._origins[:, None]).transpose(2, 0, 1))  # (mounts, H * W)
        distance[~np.array([mount.sees(self._centres) for mount in mounts])] = np.inf
        self._sensor = np.where(np.isfinite(distance.min(axis=0)), distance.argmin(axis=0), -1)  # (H * W,); -1: none sees the cell
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
        sensor = self._sensor[cell]
        if sensor < 0:
            said = np.empty(0, dtype=np.int32), np.empty(0, dtype=np.float32)
        else:
            said = _beam(self._centres[cell], self._origins[sensor], self.spec, self.beam)
        self._said[cell] = said
        return said


def _beam(centre: Floats, origin: Floats, spec: GridSpec, beam: BeamModel) -> tuple[Cells, Image]:
    """Flat cells and log-odds of a detection at `centre` seen from `origin` (both (2,), base): free on the rays, occupied at their ends."""
    distance, bearing = np.hypot(*(centre - origin)), np.arctan2(*(centre - origin)[::-1])
    sigmas = np.linspace(-2, 2, beam.rays)
    weights = np.exp(-(sigmas**2) / 2) / np.exp(-(sigmas**2) / 2).sum()
    angles = bearing + sigmas * beam.beam_sigma
    rays = np.stack((np.cos(angles), np.sin(angles)), axis=-1)  # (rays, 2)
    steps = np.arange(spec.cell / 2, distance - beam.margin * spec.cell, spec.cell / 2)
    passed = spec.locate(origin + steps[None, :, None] * rays[:, None, :])  # (rays, steps)
    size = spec.cells**2
    once = np.unique((np.arange(beam.rays)[:, None] * size + passed)[passed >= 0])  # a ray passes a cell once
    ends = spec.locate(origin + distance * rays)
    inside = ends >= 0
    cells = np.concatenate((once % size, ends[inside]))
    log_odds = np.concatenate((beam.free * weights[once // size], beam.occupied * weights[inside]))
    unique, place = np.unique(cells, return_inverse=True)
    return unique.astype(np.int32), np.bincount(place, weights=log_odds).astype(np.float32)
