"""Labels without a lidar: what looks that a map was not shown say of its cells, once the whole drive is known.

A look at a thing returns nothing most times, so one that passed says little and one that ended says where, within half a metre. Hence a
cell is called occupied where several looks agree, free where several passed and none ended near it or where the car itself drove, and
nothing is called so of the rest. That alone would teach that what lies near reflections is occupied, since nothing there is called free. So
what is learned from are chances, of cells beside a reflection too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter

from echogrid.core.motion.odometry import EgoState
from echogrid_training.evaluation.recorded.drive import Reflections
from echogrid_training.evaluation.recorded.elfes import along, once
from echogrid_training.evaluation.recorded.scores import Rectangle, swept_ground

AGREE = 2  # looks that ended in a cell or its eight neighbours, one of them in the cell itself: occupied
PASSED = 3  # looks that passed: free, if
CLEAR = 2  # cells around it have none that ended
SHORT = 0.5  # m before its end at which a ray no longer passes
# How often a cell is occupied of which hindsight says so much: rounded from what annotated scenes show (training/LOG.md).
AGREED, ONCE, BESIDE, CLEARED, DRIVEN = 0.6, 0.4, 0.15, 0.01, 0.001


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Of the cells of a rectangle, (H, W) each."""

    label: NDArray[np.int8]  # 1 occupied, -1 free, 0 not judged
    chance: NDArray[np.float32]  # that it is occupied; NaN where looks say nothing


def judge(found: Sequence[Reflections], driven: Sequence[EgoState], where: Rectangle) -> Judged:
    """The rectangle may cut looks, but holds the car's outline at all poses. `found`: independent looks that the map was not shown."""
    size = where.height * where.width
    ended, passed = np.zeros(size, np.int32), np.zeros(size, np.int32)
    for one in found:
        hit = np.unique(where.flat(one.points))
        ended[hit[hit >= 0]] += 1
        points, _ = along(one.origin, one.bearing, one.range - SHORT, SHORT, where.cell)
        through = np.unique(once(where.flat(points), np.zeros(len(points), np.int64), size))
        passed[through] += 1
    shape = where.height, where.width
    ended, passed = ended.reshape(shape), passed.reshape(shape)
    around = np.rint(9 * uniform_filter(ended.astype(float), 3, mode="constant"))
    occupied = (ended > 0) & (around >= AGREE)
    near = binary_dilation(ended > 0, np.ones((3, 3), bool), CLEAR)
    swept = swept_ground(driven, where)
    cleared = (passed >= PASSED) & ~near
    label = np.where(swept | cleared, -1, np.where(occupied, 1, 0)).astype(np.int8)
    kinds = (swept, occupied, ended > 0, near & (passed >= PASSED), cleared)
    chance = np.select(kinds, (DRIVEN, AGREED, ONCE, BESIDE, CLEARED), np.nan).astype(np.float32)
    return Judged(label, chance)
