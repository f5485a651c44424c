"""A cell's log-odds, out of what was learned and what was measured: the rule of docs/fusion.md.

Measured evidence is counted in looks, and counts as log((hits + NONE) / (passes + NONE)): where nothing was measured it says nothing, and
however sure the network is, enough looks outweigh it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map.tiled_map import FREE

Numbers = NDArray[np.float32]

LEARNED, PRIOR, SUREST = 0.46, 3.2, 1.7  # share of the network's log-odds that counts; the most it says of free, and of occupied
HIT, NEAR = 21.0, 2.5  # passes that a look with a reflection in the very cell outweighs, and one with a reflection beside it
PASS = 0.52  # looks that a passed one is worth: a beam is wider than the cell
NONE = 1.4  # looks whose evidence is not heard yet
DOUBT, SLOPE = math.log(FREE / (1 - FREE)), 0.2  # reflections beside a cell lift it out of what is free; from there on they count by SLOPE
STEEP, ALONE, ENOUGH = 4.0, 1.3, 3.4  # a network that holds a cell for occupied says so by itself: STEEP * learned + ALONE, at most ENOUGH
SILENT = np.float32(-35.0)  # log-odds beside which any other says all; exp of -inf takes ten times as long
SURER = 2.8  # how much surer than it is said to be what is free turns out to be


def read_out(learned: Numbers, hits: Numbers, near: Numbers, passes: Numbers, known: NDArray[np.bool_]) -> Numbers:
    """Log-odds of occupancy; 0 where not `known`, and only there. All of one shape; `learned`: the network's calibrated log-odds."""
    free = np.log(PASS * passes + NONE)
    prior = np.clip(np.float32(LEARNED) * learned, np.float32(-PRIOR), np.float32(SUREST)) - free
    beside = prior + np.log(NEAR * near + NONE)
    beside = np.where(beside > DOUBT, DOUBT + SLOPE * (beside - DOUBT), beside)
    inside = prior + np.log(HIT * hits + NONE)
    alone = np.where(learned == 0, SILENT, np.minimum(STEEP * learned + ALONE, ENOUGH) - free)
    strongest = np.maximum(np.maximum(beside, inside), alone)
    together = sum(np.exp(2 * (one - strongest)) for one in (beside, inside, alone))  # np.logaddexp takes ten times as long
    log_odds = strongest + np.log(together) / 2
    log_odds = np.where(log_odds < DOUBT, DOUBT + SURER * (log_odds - DOUBT), log_odds).astype(np.float32)
    log_odds[log_odds == 0] = np.finfo(np.float32).tiny
    return np.where(known, log_odds, np.float32(0))
