"""Plans of what payloads say, laid out for the loops: as `evaluate` in frames.py reads them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from echogrid.core.kernels.cells import Floats, Integers
from echogrid.core.kernels.frames import Head

MOST_SIGNALS = 128  # of a plan


class Plan(NamedTuple):
    """One plan, as if there were no other."""

    numbers: tuple[int, ...]
    scales: tuple[float, ...]


class Plans:
    """Remembers the plans so far, one behind the other."""

    def __init__(self) -> None:
        self._numbers: list[int] = []
        self._scales: list[float] = []

    def add(self, plan: Plan | None) -> int:
        """Where it begins; -1 for none."""
        if plan is None:
            return -1
        at = len(self._numbers)
        self._numbers += plan.numbers
        self._numbers[at + Head.SCALES] = len(self._scales)
        self._scales += plan.scales
        return at

    def arrays(self) -> tuple[Integers, Floats]:
        """All of them, as the loops want them."""
        return np.array(self._numbers, np.int64), np.array(self._scales, np.float64)
