"""Labels without a lidar: what looks that a map was not shown say of its cells, once the whole drive is known.

A look at a thing returns nothing most times, so one that passed says little and one that ended says where, within half a metre. Hence a
cell is called occupied where several looks agree, free where several passed and none ended near it or where the car itself drove, and
nothing is said of the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter

from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState
from echogrid_training.evaluation.recorded.drive import Reflections
from echogrid_training.evaluation.recorded.elfes import along, once
from echogrid_training.evaluation.recorded.scores import Rectangle, swept_ground

AGREE = 2  # looks that ended in a cell or its eight neighbours, one of them in the cell itself: occupied
PASSED = 3  # looks that passed: free, if
CLEAR = 2  # cells around it have none that ended
SHORT = 0.5  # m before its end at which a ray no longer passes

Judged = NDArray[np.int8]  # (H, W): 1 occupied, -1 free, 0 not judged


def judge(found: Sequence[Reflections], driven: Sequence[EgoState], where: Rectangle) -> Judged:
    """(H, W) of a rectangle that holds all of it. `found`: independent looks, none shown to the map that is to be judged."""
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
    free = ((passed >= PASSED) & ~near) | swept_ground(driven, where)
    return np.where(free, -1, np.where(occupied, 1, 0)).astype(np.int8)


def nearest_stretch(places: Floats, driven: Sequence[EgoState], stretches: Sequence[int]) -> tuple[NDArray[np.int64], Floats]:
    """For places (N, 2) m: the stretch (N,) of the nearest pose, and how far (N,) m the nearest pose of any other stretch is."""
    from scipy.spatial import cKDTree

    line = np.array([(ego.odom_from_base.x, ego.odom_from_base.y) for ego in driven])
    number = np.asarray(stretches, dtype=np.int64)
    _, nearest = cKDTree(line).query(places)
    mine, other = number[nearest], np.full(len(places), np.inf)
    for one in np.unique(number):
        away, _ = cKDTree(line[number == one]).query(places)
        other = np.where(mine == one, other, np.minimum(other, away))
    return mine, other
