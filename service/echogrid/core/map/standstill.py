"""Around a standing car: what arrives and what leaves.

A car that stands sees the same things over and over. Counted again at every update they would outweigh all that was seen from elsewhere, so
what counts is change alone: a place where reflections were usual and are missing, or were not and now come again and again.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.beams import Cells
from echogrid.core.kernels.dispatch import loops

RECENT, USUAL, SETTLED = 0.7, 20.0, 1.0  # s: that the means remember; of standing before anything is usual
LONGEST_STEP = 0.2  # s between two updates that the means move by
ARRIVES, KNOWN_BEFORE = 0.2, 0.25  # share of updates with a reflection HERE, of late; of that, how much may be usual BESIDE
STAYED, LEAVES = 0.2, 0.02  # usual share HERE of what leaves, and what is left of it BESIDE, of late
HERE, BESIDE = 0.55, 1.1  # m: a reflection's place is uncertain by half a metre, and what moves by less has not come


class Standstill:
    """Remembers how often each cell of a window had a reflection within HERE and within BESIDE, of late and usually."""

    def __init__(self, size: int, cell: float) -> None:
        """`size`: cells along a side of the window; `cell`: m."""
        self._here, self._beside = (disc(radius / cell, size) for radius in (HERE, BESIDE))
        self._recent, self._usual = (np.zeros((2, size * size), np.float32) for _ in range(2))
        self._arrived, self._left = np.empty((2, size * size), np.bool_)
        self._stood = 0.0  # s

    def see(self, hit: Cells, seconds: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """One update's reflections, flat cells (N,), `seconds` after the last. Flat masks: where something has arrived, and has left;
        they hold until the next."""
        step = min(max(seconds, 0.0), LONGEST_STEP)
        self._stood += step
        memory = min(self._stood, USUAL)
        quick, slow = 1 - math.exp(-step / RECENT), step / max(memory, step, 1e-3)  # a plain mean at first
        loops.usual(
            hit,
            self._here,
            self._beside,
            quick,
            slow,
            ARRIVES,
            KNOWN_BEFORE,
            STAYED,
            LEAVES,
            self._stood >= SETTLED,
            self._recent,
            self._usual,
            self._arrived,
            self._left,
        )
        return self._arrived, self._left


def disc(radius: float, size: int) -> Cells:
    """Offsets (K,) between flat cells of a window of size x size cells: all within `radius` cells."""
    reach = math.ceil(radius)
    row, column = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    inside = np.hypot(row, column) <= radius
    return np.asarray((row * size + column)[inside], dtype=np.int64)
