"""What changed in the window around the car: rectangles of map cells, and the one that holds all changes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
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
    return Rectangle(math.floor(pose.y / cell) - cells // 2, math.floor(pose.x / cell) - cells // 2, cells, cells)


def key_window(window: Rectangle) -> Rectangle:
    """The window of the same size that is nearest to it among those whose first cells are whole steps apart."""
    row, column, height, width = window
    return Rectangle(_whole_steps(row, height), _whole_steps(column, width), height, width)


def _whole_steps(first: int, length: int) -> int:
    """Along one axis: the first cell of the key window."""
    step = max(1, min(STEP, length // 4))
    return (first + step // 2) // step * step


def changed(before: NDArray[np.int8], after: NDArray[np.int8]) -> Rectangle:
    """The smallest rectangle of the arrays (H, W) outside which they are equal; NOTHING where they are equal everywhere."""
    found = np.empty(4, np.int64)
    loops.differing(before, after, found)
    return Rectangle(*found.tolist())
