"""A half map and its labels by hindsight, a stretch of way at a time: none is scored by what was fitted to it or to what lies beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from echogrid.core.map.tile import Layers
from echogrid.core.motion.odometry import EgoState
from echogrid_training.evaluation.recorded.scores import Rectangle
from echogrid_training.own.half import Half
from echogrid_training.own.hindsight import Judged, judge

FOLDS = 3  # each stretch in turn belongs to one of so many; those of one are scored by what is fitted to the others
GUARD = 5.0  # m: what lies so near to the way of a stretch of another fold is neither fitted to nor scored
NEAR = 60.0  # m around a stretch within which looks may touch its cells


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """What is asked about one stretch: cells that no other stretch is nearer to, and none of another fold within GUARD."""

    fold: int
    layers: Layers  # (L, K) of the cells of which hindsight says something
    chance: NDArray[np.float32]  # (K,) that each is occupied
    label: NDArray[np.int8]  # (K,) 1 occupied, -1 free, 0 not judged
    around: Layers  # (L, N, 5) of the cells of left-out detections, and of their four neighbours

    @staticmethod
    def joined(parts: Sequence[Patch]) -> Patch:
        """At least one; `fold` is the first one's."""
        layers, around = (np.concatenate([getattr(one, name) for one in parts], axis=1) for name in ("layers", "around"))
        chance, label = (np.concatenate([getattr(one, name) for one in parts]) for name in ("chance", "label"))
        return Patch(parts[0].fold, layers, chance, label, around)


def patches(half: Half) -> Iterator[Patch]:
    """In order of the stretches of the newest map."""
    number = np.asarray(half.stretches)
    for stretch in np.unique(number).tolist():
        judged, where = labels(half, [ego for ego, one in zip(half.driven, number, strict=True) if one == stretch])
        keep_own(judged, where, half, stretch)
        layers = half.map.window_of_layers(where.row, where.column, where.height, where.width)
        found = np.concatenate([np.empty((0, 2)), *(look.found.points for look in half.looks if look.stretch == stretch)])
        column, row = (np.floor(found / where.cell).astype(np.int64) - (where.column, where.row)).T
        inside = (row > 0) & (row < where.height - 1) & (column > 0) & (column < where.width - 1)
        rows, columns = row[inside, None] + (0, 1, -1, 0, 0), column[inside, None] + (0, 0, 0, 1, -1)
        known = np.isfinite(judged.chance)
        yield Patch(stretch % FOLDS, layers[:, known], judged.chance[known], judged.label[known], layers[:, rows, columns])


def labels(half: Half, around: Sequence[EgoState]) -> tuple[Judged, Rectangle]:
    """By all looks, of the cells around some poses."""
    where = Rectangle.around(around, half.map.spec.cell)
    places = np.array([(ego.odom_from_base.x, ego.odom_from_base.y) for ego in around])
    low, high = places.min(axis=0) - NEAR, places.max(axis=0) + NEAR

    def near(ego: EgoState) -> bool:
        here = np.array((ego.odom_from_base.x, ego.odom_from_base.y))
        return bool((here >= low).all() and (here <= high).all())

    driven = [ego for ego in half.driven if inside(ego, where)]
    return judge([look.found for look in half.looks if near(look.ego)], driven, where), where


def keep_own(judged: Judged, where: Rectangle, half: Half, stretch: int) -> None:
    """Takes back, in place, what was said of cells of all other stretches, and near those of other folds."""
    rows, columns = np.nonzero(np.isfinite(judged.chance))
    centres = (np.stack((columns + where.column, rows + where.row), axis=-1) + 0.5) * where.cell
    if not len(centres):
        return
    line, number = np.array([(ego.odom_from_base.x, ego.odom_from_base.y) for ego in half.driven]), np.asarray(half.stretches)
    _, nearest = cKDTree(line).query(centres)
    mine = number[nearest] == stretch
    others = line[number % FOLDS != stretch % FOLDS]
    if len(others):
        away, _ = cKDTree(others).query(centres)
        mine &= away > GUARD
    judged.label[rows[~mine], columns[~mine]] = 0
    judged.chance[rows[~mine], columns[~mine]] = np.nan


def inside(ego: EgoState, where: Rectangle) -> bool:
    """Whether the car's outline is within."""
    column, row = ego.odom_from_base.x / where.cell - where.column, ego.odom_from_base.y / where.cell - where.row
    edge = 5.0 / where.cell
    return edge < column < where.width - edge and edge < row < where.height - edge
