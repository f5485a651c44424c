"""Which cells of the map the beams of static detections touch: where a reflection may lie, and what was passed on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.messages import Floats

Cells = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Beams:
    """Static detections of one update in odom, as far as the radars see."""

    points: Floats  # (N, 2) m
    origins: Floats  # (N, 2) m, of the radars that measured them
    radars: NDArray[np.uint16]  # (N,) the bit of that radar, 1 << i for the i-th one


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A square of the map's cells; `row` and `column` of its first cell in the map."""

    row: int
    column: int
    size: int
    cell: float  # m

    def flat(self, points: Floats) -> Cells:
        """Flat index (…,) of points (…, 2) in odom; -1 for those outside."""
        place = np.floor(points / self.cell).astype(np.int64)
        column, row = place[..., 0] - self.column, place[..., 1] - self.row
        inside = (row >= 0) & (row < self.size) & (column >= 0) & (column < self.size)
        return np.where(inside, row * self.size + column, -1)


def ends(beams: Beams, window: Window, model: BeamModel) -> tuple[Cells, Floats, NDArray[np.uint16]]:
    """Where the reflections may lie, over +-2 sigma of azimuth: cells (K,), the share of a detection in each, and its radar."""
    sigmas = np.linspace(-2, 2, model.rays)
    shares = np.exp(-(sigmas**2) / 2) / np.exp(-(sigmas**2) / 2).sum()
    away = beams.points - beams.origins
    bearing = np.arctan2(away[:, 1], away[:, 0])[:, None] + sigmas * model.beam_sigma  # (N, rays)
    distance = np.hypot(away[:, 0], away[:, 1])[:, None, None]
    places = beams.origins[:, None] + distance * np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)
    flat = window.flat(places).reshape(-1)
    inside = flat >= 0
    return flat[inside], np.tile(shares, len(away))[inside], np.repeat(beams.radars, model.rays)[inside]


def passed(beams: Beams, window: Window, model: BeamModel) -> tuple[Cells, NDArray[np.uint16]]:
    """What the middles of the beams pass, up to `margin` cells before the detection: cells (M,), some twice, and the radar."""
    away = beams.points - beams.origins
    distance = np.hypot(away[:, 0], away[:, 1])
    steps = np.arange(window.cell / 2, distance.max(initial=0.0), window.cell / 2)
    beam, step = np.nonzero(steps[None, :] < (distance - model.margin * window.cell)[:, None])
    direction = away / np.maximum(distance, 1e-9)[:, None]
    flat = window.flat(beams.origins[beam] + steps[step, None] * direction[beam])
    inside = flat >= 0
    return flat[inside], beams.radars[beam[inside]]
