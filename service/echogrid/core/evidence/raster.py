"""The square of cells around the car, and the drawing of detections into it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class GridSpec:
    """`cells` x `cells` square cells of `cell` metres, base in the middle: row i is y, column j is x, cell [0, 0] at the rear right.

    The defaults are the paper's 128 x 128 cells over 30 x 30 m.
    """

    cells: int = 128
    cell: float = 30.0 / 128  # m

    @property
    def half(self) -> float:
        """Metres from base to each edge."""
        return self.cells * self.cell / 2

    def locate(self, points: Floats) -> NDArray[np.int64]:
        """Flat index (…,) into a (cells, cells) image of points (…, 2) in base; -1 for those outside."""
        place = np.floor((points + self.half) / self.cell).astype(np.int64)
        column, row = place[..., 0], place[..., 1]
        inside = (column >= 0) & (column < self.cells) & (row >= 0) & (row < self.cells)
        return np.where(inside, row * self.cells + column, -1)

    def centres(self) -> Floats:
        """(cells, cells, 2): x and y of every cell's centre in base, m."""
        axis = (np.arange(self.cells) + 0.5) * self.cell - self.half
        return np.stack(np.meshgrid(axis, axis, indexing="xy"), axis=-1)


def rasterize(points: Floats, spec: GridSpec) -> Image:
    """The paper's radar image: (1, cells, cells) float32, 1 where a static detection lies, else -1. points: (N, 2) in base, m."""
    image = np.full((1, spec.cells, spec.cells), -1.0, dtype=np.float32)
    drawn = spec.locate(points)
    image.reshape(-1)[drawn[drawn >= 0]] = 1.0
    return image
