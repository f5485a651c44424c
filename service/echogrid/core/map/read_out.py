"""A cell's log-odds, out of what was learned and what was measured: the rule of docs/fusion.md.

Measured evidence is counted in looks, and counts as log((hits + NONE) / (passes + NONE)): where nothing was measured it says nothing, and
however sure the network is, enough looks outweigh it.
"""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.kernels.dispatch import loops
from echogrid.core.map.tile import Layers
from echogrid.core.map.tiled_map import FREE, LogOdds

LEARNED, PRIOR, SUREST = 0.46, 3.2, 1.7  # share of the network's log-odds that counts; the most it says of free, and of occupied
HIT, NEAR = 21.0, 2.5  # passes that a look with a reflection in the very cell outweighs, and one with a reflection beside it
PASS = 0.52  # looks that a passed one is worth: a beam is wider than the cell
NONE = 1.4  # looks whose evidence is not heard yet
DOUBT, SLOPE = math.log(FREE / (1 - FREE)), 0.2  # reflections beside a cell lift it out of what is free; from there on they count by SLOPE
STEEP, ALONE, ENOUGH = 4.0, 1.3, 3.4  # a network that holds a cell for occupied says so by itself: STEEP * learned + ALONE, at most ENOUGH
SURER = 2.8  # how much surer than it is said to be what is free turns out to be


def read_out(layers: Layers, gain: float = 1.0, offset: float = 0.0) -> LogOdds:
    """Layers (5, …) of a LookMap -> (…) log-odds of occupancy; 0 where all layers are 0, and only there.

    `gain` and `offset` calibrate the mean of the network's log-odds.
    """
    flat = layers if layers.ndim == 3 else layers.reshape(len(layers), 1, -1)
    if flat.strides[-1] != flat.itemsize:  # the loop walks along rows
        flat = np.ascontiguousarray(flat)
    out = np.empty(flat.shape[1:], dtype=np.float32)
    loops.read_out(
        flat,
        gain,
        offset,
        LEARNED,
        PRIOR,
        SUREST,
        HIT,
        NEAR,
        PASS,
        NONE,
        DOUBT,
        FREE / (1 - FREE),
        SLOPE,
        STEEP,
        ALONE,
        ENOUGH,
        SURER,
        out,
    )
    return out.reshape(layers.shape[1:])
