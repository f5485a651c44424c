"""What changed in the window around the car: rectangles of map cells, and the one that holds all changes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from echogrid.core.motion.se2 import SE2

STEP = 32  # cells by which a key frame's window moves; a quarter of windows that are smaller than four of them


class Rectangle(NamedTuple):
    """Cells of the map: rows (y) from `row` on, columns (x) from `column` on."""

    row: int
    column: int
    height: int
    width: int

    def within(self, frame: Rectangle) -> tuple[slice, slice]:
        """Where it lies in an array of `frame`'s cells, which must hold it."""
        row, column = self.row - frame.row, self.column - frame.column
        return slice(row, row + self.height), slice(column, column + self.width)

    def joined(self, other: Rectangle) -> Rectangle:
        """The smallest rectangle that holds both; one without cells adds nothing."""
        if not self.height * self.width:
            return other
        if not other.height * other.width:
            return self
        row, column = min(self.row, other.row), min(self.column, other.column)
        bottom = max(self.row + self.height, other.row + other.height)
        right = max(self.column + self.width, other.column + other.width)
        return Rectangle(row, column, bottom - row, right - column)


NOTHING = Rectangle(0, 0, 0, 0)


def around(pose: SE2, cell: float, cells: int) -> Rectangle:
    """The window of cells x cells of `cell` m with a pose in its middle."""
    row, column = (int(np.floor(along / cell)) - cells // 2 for along in (pose.y, pose.x))
    return Rectangle(row, column, cells, cells)


def key_window(window: Rectangle) -> Rectangle:
    """The window of the same size that is nearest to it among those whose first cells are whole steps apart."""
    steps = (max(1, min(STEP, side // 4)) for side in (window.height, window.width))
    row, column = ((first + step // 2) // step * step for first, step in zip(window[:2], steps, strict=True))
    return Rectangle(row, column, window.height, window.width)


def changed(before: NDArray[Any], after: NDArray[Any]) -> Rectangle:
    """The smallest rectangle of the arrays (H, W) outside which they are equal; NOTHING where they are equal everywhere."""
    differs = before != after
    rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
    if not len(rows):
        return NOTHING
    return Rectangle(int(rows[0]), int(columns[0]), int(rows[-1] - rows[0]) + 1, int(columns[-1] - columns[0]) + 1)
