"""What can honestly be said of a map without lidar: the ground that the car drove over, and the detections that it was not shown.

Definitions and numbers are those of the reference scores that docs/real_data.md names, so that figures compare. Maps are compared at equal
areas, for a map that calls everything occupied finds all, and one that calls everything free is free of nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map import tiled_map
from echogrid.core.map.tile import SIDE, Layers
from echogrid.core.map.tiled_map import LogOdds, TiledMap
from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState
from echogrid_training.evaluation.metrics import Mask

OCCUPIED, FREE = (math.log(p / (1 - p)) for p in (tiled_map.OCCUPIED, tiled_map.FREE))  # log-odds: as map.yaml calls cells
MARGIN = 30.0  # m around the driven line: nothing that is scored is farther away
OUTLINE = (-0.95, 3.65, -0.9, 0.9)  # m in base: x and y from and to of what a car sweeps; one cell less is surely driven over


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Of a map's cells, in odom: row and column of the first, how many; `cell` in m."""

    row: int
    column: int
    height: int
    width: int
    cell: float

    @staticmethod
    def around(driven: Sequence[EgoState], cell: float) -> Rectangle:
        """All cells within MARGIN of the driven line, and more."""
        places = np.array([(ego.odom_from_base.y, ego.odom_from_base.x) for ego in driven]).reshape(-1, 2)
        row, column = np.floor((places.min(axis=0) - MARGIN) / cell).astype(int).tolist()
        last_row, last_column = np.floor((places.max(axis=0) + MARGIN) / cell).astype(int).tolist()
        return Rectangle(row, column, last_row - row + 1, last_column - column + 1, cell)

    def cut(self, ego: EgoState, most: int) -> Rectangle:
        """The part of it around a pose that is at most so many cells high and wide."""
        wanted = np.floor(np.array((ego.odom_from_base.y, ego.odom_from_base.x)) / self.cell).astype(int) - most // 2
        first, size = np.array((self.row, self.column)), np.array((self.height, self.width))
        row, column = np.clip(wanted, first, first + np.maximum(size - most, 0)).tolist()
        return Rectangle(row, column, min(self.height, most), min(self.width, most), self.cell)

    def flat(self, points: Floats) -> NDArray[np.int64]:
        """Flat index (N,) of points (N, 2) m into (H, W); -1 for those outside."""
        column, row = (np.floor(points / self.cell).astype(np.int64) - (self.column, self.row)).T
        inside = (row >= 0) & (row < self.height) & (column >= 0) & (column < self.width)
        return np.where(inside, row * self.width + column, -1)

    def read(self, occupancy: TiledMap, read: Callable[[Layers], LogOdds] | None = None) -> LogOdds:
        """(H, W) log-odds of a map, as it reads its layers or as `read` does."""
        rows = [(first, min(SIDE, self.height - first)) for first in range(0, self.height, SIDE)]  # at once, layers may be gigabytes
        strips = [occupancy.window_of_layers(self.row + first, self.column, count, self.width) for first, count in rows]
        return np.concatenate([(read or occupancy.read)(strip) for strip in strips])


@dataclass(frozen=True, slots=True, eq=False)
class Said:
    """What a map says at some places. `reach`: the largest log-odds of a cell and its four neighbours, -inf where none is observed.

    A cell that reaches more than a threshold is one that the occupied cells cover when they are widened by one cell.
    """

    swept: LogOdds  # (S,) log-odds of the ground that the car drove over
    observed: LogOdds  # (K,) log-odds of all observed cells
    reach_observed: LogOdds  # (K,) of the same
    reach: LogOdds  # (R,) of all cells that have one
    left_out: LogOdds  # (T,) log-odds where the detections lie that were left out
    reach_left_out: LogOdds  # (T,)
    cell: float  # m


@dataclass(frozen=True, slots=True)
class Occupied:
    """The map's occupied side at a threshold."""

    threshold: float  # log-odds; above is occupied
    covered_m2: float  # by the occupied cells, widened by one
    covered_share: float  # of the area that the map itself has observed
    recall: float  # share of the left-out detections that are covered
    swept: float  # share of the swept ground that is occupied by this threshold


@dataclass(frozen=True, slots=True)
class Free:
    """Its free side."""

    threshold: float  # log-odds; below is surely free
    free_m2: float
    false_free: float  # share of the left-out detections in cells that are surely free


def say(log_odds: LogOdds, where: Rectangle, swept: Mask, left_out: Floats) -> Said:
    """log_odds and swept: (H, W) of the rectangle; left_out: (T, 2) m in odom, all of them in it."""
    known = log_odds != 0
    reach = reached(np.where(known, log_odds, np.float32(-np.inf)))
    asked = where.flat(left_out)
    return Said(
        swept=log_odds[swept],
        observed=log_odds[known],
        reach_observed=reach[known],
        reach=reach[reach > -np.inf],
        left_out=log_odds.reshape(-1)[asked],
        reach_left_out=reach.reshape(-1)[asked],
        cell=where.cell,
    )


def reached(log_odds: LogOdds) -> LogOdds:
    """(H, W): the largest of each cell and its four neighbours."""
    out = log_odds.copy()
    for here, there in ((np.s_[1:], np.s_[:-1]), (np.s_[:-1], np.s_[1:]), (np.s_[:, 1:], np.s_[:, :-1]), (np.s_[:, :-1], np.s_[:, 1:])):
        np.maximum(out[here], log_odds[there], out=out[here])
    return out


def swept_ground(driven: Sequence[EgoState], where: Rectangle) -> Mask:
    """(H, W) cells that the car's outline, a cell smaller on each side, passed over."""
    step = where.cell
    low_x, high_x, low_y, high_y = OUTLINE
    x, y = np.meshgrid(np.arange(low_x + step, high_x - step, step / 2), np.arange(low_y + step, high_y - step, step / 2))
    outline = np.stack((x.reshape(-1), y.reshape(-1)), axis=-1)
    out = np.zeros(where.height * where.width, dtype=np.bool_)
    for ego in driven:
        out[where.flat(ego.odom_from_base.apply(outline))] = True
    return out.reshape(where.height, where.width)


def occupied_at(said: Said, threshold: float) -> Occupied:
    return Occupied(
        threshold,
        covered_m2=int(np.count_nonzero(said.reach > threshold)) * said.cell**2,
        covered_share=share(said.reach_observed > threshold),
        recall=share(said.reach_left_out > threshold),
        swept=share((said.swept > threshold) & (said.swept != 0)),
    )


def free_at(said: Said, threshold: float) -> Free:
    free = int(np.count_nonzero(said.observed < threshold))
    return Free(threshold, free * said.cell**2, share((said.left_out < threshold) & (said.left_out != 0)))


def at_area(said: Said, square_metres: float) -> Occupied:
    """With the lowest threshold that covers no larger area."""
    return occupied_at(said, above(said.reach, round(square_metres / said.cell**2)))


def at_share(said: Said, covered: float) -> Occupied:
    """With the lowest threshold that covers no larger share of what the map itself has observed."""
    return occupied_at(said, above(said.reach_observed, int(covered * len(said.observed) + 1e-6)))


def at_free_area(said: Said, square_metres: float) -> Free:
    """With the highest threshold that calls no larger area surely free."""
    return free_at(said, -above(-said.observed, round(square_metres / said.cell**2)))


def above(values: LogOdds, count: int) -> float:
    """The lowest threshold that not more than `count` of the values lie above; -inf where all may."""
    if count >= len(values):
        return float("-inf")
    place = len(values) - 1 - count
    return float(np.partition(values, place)[place])


def share(which: Mask) -> float:
    """NaN of none."""
    return float(which.mean()) if which.size else float("nan")
