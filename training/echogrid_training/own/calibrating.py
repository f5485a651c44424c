"""The last step alone: two numbers by which a network's answers are read out of the map, fitted to hindsight.

What is minimised is the cost of what is decided at the published thresholds, since the read-out calls what lies beside reflections doubtful
on purpose, and a fit that minds probabilities alone would give that up. It may not be saved by finding less: where too much is called
occupied, that is always the cheapest, and nobody asked for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from echogrid.core.map.look_map import Calibration
from echogrid.core.map.read_out import read_out
from echogrid.core.map.tile import Layers
from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.messages import Floats
from echogrid_training.evaluation.metrics import ratio
from echogrid_training.evaluation.recorded.scores import FREE, OCCUPIED
from echogrid_training.own.patches import Patch
from echogrid_training.own.worth import INTERVAL, drawn

MOST = 60_000  # cells that are fitted to, and detections, evenly chosen
LOWEST, HIGHEST = 0.1, 4.0  # of `learned`: a network that is not believed at all, or more than it says, is no calibration
FARTHEST = 4.0  # of `offset` from 0
# What is lost by a reflection that is not found, one called free, a free cell not called so, one called occupied. Beside annotated truth
# these shares rise and fall with objects found and called free, and road called free and occupied (training/LOG.md).
MISSED, HIDDEN, DOUBTED, PHANTOM = 1.0, 5.0, 1.0, 50.0
# First steps, times `learned` and plus `offset`: one at a time, then both, for the search gets stuck where just as much is found as before,
# and there they rise together.
ALONE, TOGETHER = ((1.3, 0.0), (1.0, 0.6)), ((1.4, 0.8), (1.2, 0.8))
LESS = 1000.0  # lost on top by what is found less than before: more than anything can save


@dataclass(frozen=True, slots=True)
class Scores:
    """At the published thresholds; NaN of nothing."""

    detections: int  # that the map was not shown
    found: float  # share of them within a cell of an occupied one
    called_free: float  # share of them in cells called free
    cells: int  # of which hindsight says something
    free_called_free: float  # of those that it calls free
    free_called_occupied: float
    nll: float  # nats a cell, expected by hindsight's chances

    @property
    def cost(self) -> float:
        """Of what is decided; what there is nothing of costs nothing."""
        lost = (
            (1 - self.found) * MISSED,
            self.called_free * HIDDEN,
            (1 - self.free_called_free) * DOUBTED,
            self.free_called_occupied * PHANTOM,
        )
        return float(np.nansum(lost))


def fitted(part: Patch, start: Calibration) -> Calibration:
    """The numbers by which decisions cost least, of those that find no less of the left-out detections than `start` does."""
    part = thinned(part)
    least = score(part, start).found

    def cost(numbers: Floats) -> float:
        learned, offset = numbers.tolist()
        outside = max(LOWEST - learned, learned - HIGHEST, abs(offset) - FARTHEST, 0.0)
        tried = score(part, Calibration(learned, offset))
        return float(tried.cost + outside + LESS * max(0.0, least - tried.found))

    best = np.array((start.learned, start.offset))
    for steps in ALONE, TOGETHER:
        first = np.stack((best, *(best * (gain, 1.0) + (0.0, rise) for gain, rise in steps)))
        best = minimize(cost, best, method="Nelder-Mead", options={"xatol": 3e-3, "fatol": 1e-5, "initial_simplex": first}).x
    learned, offset = best.tolist()
    return Calibration(round(learned, 4), round(offset, 4))


def crossed(parts: Sequence[Patch], start: Calibration) -> Floats:
    """(S, 8), `counts` of the stretches in their order, each by the numbers that are fitted to the other folds."""
    by_fold = {fold: fitted(Patch.joined([one for one in parts if one.fold != fold]), start) for fold in {one.fold for one in parts}}
    return np.stack([counts(one, by_fold[one.fold]) for one in parts])


def thinned(part: Patch) -> Patch:
    """At most MOST cells and detections."""
    cells, found = (np.linspace(0, size - 1, min(size, MOST)).astype(np.intp) for size in (len(part.chance), part.around.shape[1]))
    return Patch(part.fold, part.layers[:, cells], part.chance[cells], part.label[cells], part.around[:, found])


def score(part: Patch, calibration: Calibration) -> Scores:
    """What a map says of it when it is read out so."""
    return scores(counts(part, calibration))


def counts(part: Patch, calibration: Calibration) -> Floats:
    """(8,) that add up over patches: detections, found, called free; free cells, called free, called occupied; cells, nats of surprise."""
    said, near = read(part.layers, calibration), read(part.around, calibration)
    reach, free = np.where(near == 0, -np.inf, near).max(axis=1, initial=-np.inf), part.label < 0
    here, known = near[:, 0], said != 0
    surprise = expected_surprise(said[known], part.chance[known])
    found = (len(here), (reach > OCCUPIED).sum(), ((here < FREE) & (here != 0)).sum())
    cells = (free.sum(), ((said < FREE) & known & free).sum(), ((said > OCCUPIED) & known & free).sum())
    return np.array((*found, *cells, len(surprise), surprise.sum()), dtype=float)


def scores(total: Floats) -> Scores:
    """Of `counts`, summed."""
    detections, found, hidden, free, kept, phantom, cells, surprise = total.tolist()
    return Scores(
        detections=int(detections),
        found=ratio(found, detections),
        called_free=ratio(hidden, detections),
        cells=int(cells),
        free_called_free=ratio(kept, free),
        free_called_occupied=ratio(phantom, free),
        nll=ratio(surprise, cells),
    )


def surely_better(before: Floats, after: Floats) -> float:
    """Share of draws of stretches in which `after` costs less; both (S, 8), `counts` of the same stretches."""
    less = [scores(after[one].sum(axis=0)).cost < scores(before[one].sum(axis=0)).cost for one in drawn(len(before))]
    return float(np.mean(less))


def least_found(before: Floats) -> float:
    """The lower end of the middle 95 % of draws of stretches of what is found; of (S, 8), `counts` of stretches. NaN of nothing."""
    return float(np.percentile([scores(before[one].sum(axis=0)).found for one in drawn(len(before))], INTERVAL[0]))


def expected_surprise(log_odds: LogOdds, chance: NDArray[np.floating]) -> Floats:
    """(N,) nats, for what is occupied with a chance."""
    lost: Floats = (chance * np.logaddexp(0.0, -log_odds) + (1 - chance) * np.logaddexp(0.0, log_odds)).astype(float)
    return lost


def read(layers: Layers, calibration: Calibration) -> LogOdds:
    """As LookMap reads them, with other numbers; layers (5, …)."""
    return read_out(np.ascontiguousarray(layers), calibration.learned, calibration.offset)
