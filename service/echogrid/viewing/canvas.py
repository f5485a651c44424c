"""What is known of the map so far, in blocks; tells which of them a window changes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.viewing.wire import DTYPES, EMPTY, SIDE, BlockKey, Plane

Blocks = dict[BlockKey, NDArray[Any]]


class Canvas:
    """Remembers the blocks of each plane: (SIDE, SIDE) arrays that are replaced, never changed."""

    def __init__(self) -> None:
        self.planes: dict[Plane, Blocks] = {plane: {} for plane in Plane}

    def put(self, plane: Plane, row: int, column: int, cells: NDArray[Any]) -> Blocks:
        """Takes cells (H, W), the first of them at this row and column of the map; the blocks that differ from before."""
        top, left = row // SIDE, column // SIDE
        rows, columns = -(-(row + cells.shape[0]) // SIDE) - top, -(-(column + cells.shape[1]) // SIDE) - left
        known = self.planes[plane]
        before = np.full((rows * SIDE, columns * SIDE), EMPTY[plane], DTYPES[plane])
        for i in range(rows):
            for j in range(columns):
                block = known.get((top + i, left + j))
                if block is not None:
                    before[i * SIDE : (i + 1) * SIDE, j * SIDE : (j + 1) * SIDE] = block
        after = before.copy()
        inside = row - top * SIDE, column - left * SIDE
        after[inside[0] : inside[0] + cells.shape[0], inside[1] : inside[1] + cells.shape[1]] = cells
        differs = (before != after).reshape(rows, SIDE, columns, SIDE).any(axis=(1, 3))
        changed = {
            (top + i, left + j): after[i * SIDE : (i + 1) * SIDE, j * SIDE : (j + 1) * SIDE].copy()
            for i, j in np.argwhere(differs).tolist()
        }
        known.update(changed)
        return changed

    def clear(self) -> None:
        """Another map; the truth stays true."""
        for plane in Plane:
            if plane is not Plane.TRUTH:
                self.planes[plane].clear()

    def keep_near(self, row: int, column: int, cells: int) -> None:
        """Forgets the blocks that are farther than so many cells from a cell; not those of the truth."""
        reach, i, j = cells / SIDE, row / SIDE, column / SIDE
        for plane, known in self.planes.items():
            if plane is not Plane.TRUTH:
                for key in [key for key in known if math.hypot(key[0] + 0.5 - i, key[1] + 0.5 - j) > reach]:
                    del known[key]
