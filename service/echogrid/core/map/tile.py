"""A square of the map: what its cells hold, when each was last in view, and which radars have had it in view."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

SIDE = 128  # cells along a tile's side
MOST_RADARS = 16  # bits of `radars`
Layers = NDArray[np.float32]  # (L, H, W)
TileKey = tuple[int, int]  # row and column of tiles: cell (i, j) of the map lies in tile (i // SIDE, j // SIDE)


@dataclass(slots=True, eq=False)
class Tile:
    """Changed in place by the map that it belongs to."""

    layers: Layers  # (L, SIDE, SIDE), as the map's rule needs them; 0 where nothing was ever said
    seen_s: NDArray[np.uint32]  # (SIDE, SIDE) Unix time in s of the newest update that had the cell in view; 0: none had
    radars: NDArray[np.uint16]  # (SIDE, SIDE) bit i is set where radar i of the configuration has had the cell in view

    @classmethod
    def empty(cls, layers: int) -> Self:
        """Nothing is known."""
        shape = (SIDE, SIDE)
        return cls(np.zeros((layers, *shape), np.float32), np.zeros(shape, np.uint32), np.zeros(shape, np.uint16))

    def copy(self) -> Tile:
        """What it holds now."""
        return Tile(self.layers.copy(), self.seen_s.copy(), self.radars.copy())

    def become(self, other: Tile) -> None:
        """A copy of a tile with as many layers, in the same memory."""
        self.layers[:], self.seen_s[:], self.radars[:] = other.layers, other.seen_s, other.radars


def tile_bytes(layers: int) -> int:
    """Of a tile in memory."""
    return SIDE * SIDE * (4 * layers + 4 + 2)


def tiles_under(row: int, column: int, height: int, width: int) -> list[TileKey]:
    """Those that hold cells of a rectangle, by rows."""
    columns = range(column // SIDE, (column + width - 1) // SIDE + 1)
    return [(one, other) for one in range(row // SIDE, (row + height - 1) // SIDE + 1) for other in columns]


def most_tiles_along(cells: int) -> int:
    """That a row of `cells` cells can touch, wherever it begins."""
    return (cells + SIDE - 2) // SIDE + 1
