"""How a method's scores are read as log-odds: the same few numbers for every method, fitted on towns of their own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid_training.evaluation.metrics import Mask, best_threshold, surprise
from echogrid_training.learning.logistic import fit_logistic

Scores = NDArray[np.float32]  # the higher, the more likely occupied; exactly 0 where a method says nothing


@dataclass(frozen=True, slots=True)
class Reading:
    """log-odds = slope * score + offset, `silent` where a method says nothing; from `threshold` on a cell counts as occupied."""

    slope: float
    offset: float
    silent: float
    threshold: float

    def __call__(self, scores: Scores) -> Floats:
        """Log-odds of scores of any shape."""
        return np.where(scores == 0, self.silent, self.slope * scores.astype(float) + self.offset)


def fit_reading(scores: Scores, occupied: Mask) -> Reading:
    """By greatest likelihood of occupied (N,), and the threshold of the best overlap. scores: (N,) of cells that truth observed.

    What saying nothing is worth is the share of occupied cells among those.
    """
    said = scores != 0
    spoken = scores[said].astype(float)
    middle, width = (spoken.mean(), spoken.std() or 1.0) if len(spoken) else (0.0, 1.0)  # so that a score's unit is of no account
    features = np.stack(((spoken - middle) / width, np.ones(len(spoken))))
    prior = (occupied.sum() + 0.5) / (len(occupied) + 1)
    start = np.array([0.0, np.log(prior / (1 - prior))])
    slope, offset = fit_logistic(features, occupied[said], start) if len(spoken) else start
    read = Reading(float(slope / width), float(offset - slope * middle / width), _share(occupied[~said], prior), np.inf)
    return Reading(read.slope, read.offset, read.silent, best_threshold(read(scores), occupied))


def unlikelihood(scores: Scores, occupied: Mask) -> float:
    """Mean -ln of what the best reading of these scores says about the truth: what a method's own parameters are tuned by."""
    return float(surprise(fit_reading(scores, occupied)(scores), occupied).mean())


def _share(occupied: Mask, prior: float) -> float:
    """Log-odds of the share of occupied cells, one cell like `prior` among them."""
    return float(np.log((occupied.sum() + prior) / ((~occupied).sum() + 1 - prior)))
