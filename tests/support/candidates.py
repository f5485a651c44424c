"""Fewer candidates for the baselines of `evaluate sim`: choosing among three is as choosing among a hundred."""

from __future__ import annotations

import pytest

from echogrid_training.evaluation.simulated import calibrating
from echogrid_training.evaluation.simulated.baselines import BASELINES

PATCHES, KEPT = 3, 3


def few(patch: pytest.MonkeyPatch) -> None:
    """Of each baseline's grid and of Elfes' summed maps KEPT, evenly; PATCHES of a calibration drive."""
    patch.setattr(calibrating, "PATCHES", PATCHES)
    patch.setattr(calibrating, "BASELINES", {name: grid[:: -(-len(grid) // KEPT)] for name, grid in BASELINES.items()})
    patch.setattr(calibrating, "SUMMED", calibrating.SUMMED[:: -(-len(calibrating.SUMMED) // KEPT)])
