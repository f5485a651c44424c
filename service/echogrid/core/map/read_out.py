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

LEARNED, PRIOR, SUREST = 0.372, 2.8, 1.7  # share of the network's log-odds that counts; the most it says of free, and of occupied
HIT, NEAR = 21.0, 2.2  # what a look with a reflection in the very cell counts, and one with a reflection beside it
PASS = 0.4  # what a passed one counts; n of them count n to the power of 1.25, for they contradict one another less than reflections do
NONE = 2.8  # looks whose evidence is not heard yet
DOUBT, SLOPE = math.log(FREE / (1 - FREE)), 0.38  # reflections beside a cell lift it out of what is free; from there on they count by SLOPE
STEEP, ALONE, ENOUGH = 4.0, 2.0, 3.3  # a network that holds a cell for occupied says so by itself: STEEP * learned + ALONE, at most ENOUGH
SURER, CALMER = 4.2, 0.72  # how much surer than it is said to be what is free turns out to be, and what is occupied
LEAST = math.log(0.106 / 0.894)  # what a cell says at least that is not free: in percent it is 11, and no rounding makes it free


_ALL = LEARNED, PRIOR, SUREST, HIT, NEAR, PASS, NONE, DOUBT, FREE / (1 - FREE), SLOPE, STEEP, ALONE, ENOUGH, SURER, LEAST, CALMER
RULE = np.array(_ALL, np.float32)  # as the loop takes it
FIRST = np.zeros((1, 2), np.int64)  # the place of a part that is all there is


def read_out(layers: Layers, gain: float = 1.0, offset: float = 0.0) -> LogOdds:
    """Layers (5, …) of a LookMap -> (…) log-odds of occupancy; 0 where all layers are 0, and only there.

    `gain` and `offset` calibrate the mean of the network's log-odds.
    """
    flat = layers if layers.ndim == 3 else layers.reshape(len(layers), 1, -1)
    if flat.strides[-1] != flat.itemsize:  # the loop walks along rows
        flat = np.ascontiguousarray(flat)
    out = np.empty(flat.shape[1:], dtype=np.float32)
    loops.read_out(0, 0, FIRST, [flat], gain, offset, RULE, out)
    return out.reshape(layers.shape[1:])
