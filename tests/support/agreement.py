"""How far two maps of the same places say the same."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.ndimage import binary_dilation

from echogrid.core.evidence.raster import Image

CELL = np.ones((3, 3), bool)


def agreement(patches: Iterable[tuple[Image, Image]]) -> tuple[float, float]:
    """IoU of occupied within a cell, and of free where both know, over pairs of patches (H, W) of log-odds, 0 for unknown."""
    near = sides = both_free = some_free = 0
    for a, b in patches:
        near += (binary_dilation(a > 0, CELL) & (b > 0)).sum() + (binary_dilation(b > 0, CELL) & (a > 0)).sum()
        sides += (a > 0).sum() + (b > 0).sum()
        known = (a != 0) & (b != 0)
        both_free += ((a < 0) & (b < 0)).sum()
        some_free += (((a < 0) | (b < 0)) & known).sum()
    return near / 2 / (sides - near / 2), both_free / some_free
