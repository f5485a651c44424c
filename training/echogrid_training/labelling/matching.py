"""Dead reckoning put right by the lidar: each turn is laid on the walls of those before it, by lines through neighbouring returns.

Dead reckoning of a production car is off by decimetres and degrees within seconds, which doubles walls. A turn that meets too little to be
laid on goes on by dead reckoning.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2

MOST = 900  # returns of a turn that are laid
KEYS, KEY_STEP, KEY_TURN = 25, 0.7, math.radians(8.0)  # turns that are remembered; m and rad after which one is
NEIGHBOURS, THIN = 8, 0.1  # returns that a line goes through, and how wide they may lie beside it, of their length
REACH = ((0.7, 4), (0.35, 8))  # m within which a line is taken to be the same, and steps
HUBER = 0.08  # m from which on a return counts less
LEAST = 80  # returns that have to meet a line
SOFT = 100.0  # weight of dead reckoning since the last turn, in returns: it decides along directions that hardly a line holds


class Matcher:
    """Remembers the last key turns in odom, and where the last turn was laid."""

    def __init__(self) -> None:
        self._keys: list[tuple[Floats, Floats]] = []  # returns (N, 2) m and the normals of their lines (N, 2)
        self._tree: cKDTree | None = None
        self._last_key: SE2 | None = None
        self._before: tuple[SE2, SE2] | None = None  # dead-reckoned and laid

    def lay(self, reckoned: SE2, points: Floats) -> SE2:
        """odom_from_base of a turn whose standing returns (N, 2) m are given in base, dead-reckoned at `reckoned`."""
        pose = reckoned if self._before is None else self._before[1] @ (self._before[0].inverse() @ reckoned)
        points = points[:: max(1, -(-len(points) // MOST))]
        pose = self._laid(pose, points)
        self._before = (reckoned, pose)
        last = self._last_key
        if last is None or math.hypot(pose.x - last.x, pose.y - last.y) > KEY_STEP or abs(pose.yaw - last.yaw) > KEY_TURN:
            self._keep(pose, points)
        return pose

    def _laid(self, pose: SE2, points: Floats) -> SE2:
        if self._tree is None or len(points) < LEAST:
            return pose
        returns = np.concatenate([key[0] for key in self._keys])
        normals = np.concatenate([key[1] for key in self._keys])
        guess = pose
        for reach, steps in REACH:
            for _ in range(steps):
                moved = guess.apply(points)
                distance, nearest = self._tree.query(moved, distance_upper_bound=reach)
                met = np.isfinite(distance)
                if met.sum() < LEAST:
                    return pose
                normal, at = normals[nearest[met]], moved[met]
                off = ((at - returns[nearest[met]]) * normal).sum(axis=1)
                arm = at - (guess.x, guess.y)
                slope = np.column_stack((normal, normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]))
                weight = HUBER / np.maximum(np.abs(off), HUBER)
                curve = (slope * weight[:, None]).T @ slope + np.diag((SOFT, SOFT, SOFT * 25.0))
                back = np.array((guess.x - pose.x, guess.y - pose.y, (guess.yaw - pose.yaw) * 25.0)) * SOFT
                step = -np.linalg.solve(curve, slope.T @ (weight * off) + back)
                guess = SE2(guess.x + float(step[0]), guess.y + float(step[1]), guess.yaw + float(step[2]))
                if np.abs(step).max() < 1e-4:
                    break
        return guess

    def _keep(self, pose: SE2, points: Floats) -> None:
        self._last_key = pose
        returns = pose.apply(points)
        if len(returns) <= NEIGHBOURS:
            return
        normal, straight = lines(returns)
        self._keys = [*self._keys[-KEYS + 1 :], (returns[straight], normal[straight])]
        self._tree = cKDTree(np.concatenate([key[0] for key in self._keys]))


def lines(points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """For points (N, 2): the normal (N, 2) of the line through each one's neighbours, and whether they lie on one."""
    _, near = cKDTree(points).query(points, NEIGHBOURS)
    around = points[near] - points[near].mean(axis=1, keepdims=True)
    size, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    straight: NDArray[np.bool_] = (size[:, 0] < THIN**2 * size[:, 1]) & (size[:, 1] > 1e-6)
    return axes[:, :, 0], straight
