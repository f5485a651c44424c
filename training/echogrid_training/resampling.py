"""Towns drawn anew with replacement: how much a figure hangs on which towns it was measured in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats

RESAMPLED, INTERVAL = 1000, (2.5, 97.5)


def resamples(towns: int, seed: int = 0) -> NDArray[np.int64]:
    """(RESAMPLED, towns): how often each town is drawn, as many draws as towns, with replacement."""
    return np.random.default_rng(seed).multinomial(towns, np.full(towns, 1 / towns), size=RESAMPLED)


def interval(values: Floats) -> tuple[float, float]:
    """The middle 95 in 100 of resampled figures."""
    low, high = np.nanpercentile(values, INTERVAL)
    return float(low), float(high)
