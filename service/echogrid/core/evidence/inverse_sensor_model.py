"""The analytic inverse sensor model (Elfes 1989) with the network's signature: a radar image in, log-odds out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats
from echogrid.core.radar.mount import Mount


@dataclass(frozen=True, slots=True)
class BeamModel:
    """What one detection says about the cells of its beam: log-odds, spread over the rays by the azimuth's distribution."""

    occupied: float = 1.7  # all that is spread over the cells where the reflection may lie
    free: float = -0.12  # of a cell that the whole beam passes
    beam_sigma: float = 0.018  # rad, of the azimuth
    rays: int = 5  # over +-2 sigma
    margin: float = 2.0  # cells before the detection that the ray says nothing about

    def spread(self) -> tuple[Floats, Floats]:
        """(rays,): by how many sigmas each ray is off the middle, and its share of the detection."""
        sigmas = np.linspace(-2, 2, self.rays)
        weights = np.exp(-(sigmas**2) / 2)
        return sigmas, weights / weights.sum()


class AnalyticSensorModel:
    """Callable (1, H, W) image in [-1, 1] -> (H, W) log-odds, 0 where it says nothing.

    A radar image does not say which radar saw what, so each cell's beam comes from the nearest radar that has it in view. Mounts and
    grid are fixed, so which one that is, how far it is and where its rays go are worked out once.
    """

    def __init__(self, spec: GridSpec, mounts: Sequence[Mount], beam: BeamModel | None = None) -> None:
        self.spec = spec
        self.beam = beam or BeamModel()
        sigmas, self._weights = self.beam.spread()
        self._offsets = sigmas * self.beam.beam_sigma  # rad, of the rays
        centres = spec.centres().reshape(-1, 2)
        origins = np.array([(mount.base_from_sensor.x, mount.base_from_sensor.y) for mount in mounts]).reshape(-1, 2)
        distance = np.hypot(*(centres[None] - origins[:, None]).transpose(2, 0, 1))  # (mounts, H * W)
        distance[~np.array([mount.sees(centres) for mount in mounts])] = np.inf
        nearest = distance.argmin(axis=0)
        self._seen = np.isfinite(distance.min(axis=0))  # (H * W,) by any
        self._origins = origins[nearest]  # (H * W, 2) m
        away = centres - self._origins
        self._distance, self._bearing = np.hypot(*away.T), np.arctan2(*away.T[::-1])  # (H * W,) m, rad

    def __call__(self, image: Image) -> Image:
        """Sum of what every drawn detection says."""
        drawn = np.flatnonzero((image[0].reshape(-1) > 0) & self._seen)
        angles = self._bearing[drawn, None] + self._offsets
        rays = np.empty((*angles.shape, 2))  # (D, rays, 2)
        np.cos(angles, out=rays[..., 0])
        np.sin(angles, out=rays[..., 1])
        spec, beam, out = self.spec, self.beam, np.empty(image[0].shape, dtype=np.float32)
        margin = beam.margin * spec.cell
        origins, distance = self._origins[drawn], self._distance[drawn]
        loops.elfes(origins, distance, rays, self._weights, spec.half, spec.cell, beam.free, beam.occupied, margin, out)
        return out
