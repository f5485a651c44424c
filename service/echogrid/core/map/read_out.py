"""A cell's log-odds, out of what was learned and what was measured: the rule of docs/fusion.md.

Measured evidence is counted in looks, and counts as log((hits + NONE) / (passes + NONE)): where nothing was measured it says nothing, and
however sure the network is, enough looks outweigh it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float32]

LEARNED, PRIOR, SUREST = 0.43, 3.0, 1.5  # share of the network's log-odds that counts; the most it says of free, and of occupied
HIT, NEAR = 30.0, 1.6  # passes that a look with a reflection in the very cell outweighs, and one with a reflection beside it
PASS = 0.62  # looks that a passed one is worth: a beam is wider than the cell
NONE = 1.2  # looks whose evidence is not heard yet
DOUBT, SLOPE = -1.48, 0.18  # what reflections beside a cell alone lift it to; from there on they count by SLOPE


def read_out(learned: Numbers, hits: Numbers, near: Numbers, passes: Numbers, known: NDArray[np.bool_]) -> Numbers:
    """Log-odds of occupancy; 0 where not `known`, and only there. All of one shape; `learned`: the network's calibrated log-odds."""
    prior = np.clip(np.float32(LEARNED) * learned, np.float32(-PRIOR), np.float32(SUREST)) - np.log(PASS * passes + NONE)
    beside = prior + np.log(NEAR * near + NONE)
    beside = np.where(beside > DOUBT, DOUBT + SLOPE * (beside - DOUBT), beside)
    inside = prior + np.log(HIT * hits + NONE)
    log_odds = (np.logaddexp(2 * beside, 2 * inside) / 2).astype(np.float32)
    log_odds[log_odds == 0] = np.finfo(np.float32).tiny
    return np.where(known, log_odds, np.float32(0))
