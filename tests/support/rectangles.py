"""Samples of rooms without a simulator: to learn from in seconds."""

from __future__ import annotations

import numpy as np

from echogrid.core.evidence.history_raster import CHANNELS
from echogrid.core.motion.se2 import IDENTITY
from echogrid_training.drives.samples import Sample
from echogrid_training.learning.dataset import Samples, packed


def rectangles(count: int, seed: int) -> Samples:
    """Rooms around the car: some detections on the walls; free inside, occupied on the walls, unknown beyond."""
    rng = np.random.default_rng(seed)
    cut = []
    for _ in range(count):
        low, high = rng.integers(10, 50, 2), rng.integers(78, 118, 2)
        truth = np.zeros((128, 128), np.float32)
        truth[low[0] : high[0], low[1] : high[1]] = 3.0
        truth[low[0] + 2 : high[0] - 2, low[1] + 2 : high[1] - 2] = -3.0
        image = np.zeros((12, 128, 128), np.uint8)
        image[0] = 32 * ((truth > 0) & (rng.uniform(size=truth.shape) < 0.2))
        image[CHANNELS.index("count_15m")] = 64 * ((truth > 0) & (rng.uniform(size=truth.shape) < 0.5))
        image[CHANNELS.index("looks_15m")] = 200 * (truth != 0)
        cut.append(Sample(0, (truth > 0).astype(np.uint8), image, truth, IDENTITY))
    return packed(cut)
