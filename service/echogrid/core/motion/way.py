"""Where the car was in the newest map, at every 20 ms: numbers in a row, so that a long recording takes 6 MB an hour of it."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Sequence
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState

STEP_NS = 20_000_000
_stamp_ns = attrgetter("stamp_ns")


class Way:
    """Remembers stamps, and x, y and yaw one after the other."""

    def __init__(self) -> None:
        self._stamps = array("q")
        self._poses = array("d")

    def __len__(self) -> int:
        return len(self._stamps)

    def follow(self, states: Sequence[EgoState]) -> None:
        """Takes what is new of the last states, by time."""
        last_ns = self._stamps[-1] if self._stamps else None
        for state in states if last_ns is None else states[bisect_right(states, last_ns, key=_stamp_ns) :]:
            if last_ns is None or state.stamp_ns - last_ns >= STEP_NS:
                pose = state.odom_from_base
                self._stamps.append(state.stamp_ns)
                self._poses.extend((pose.x, pose.y, pose.yaw))
                last_ns = state.stamp_ns

    def clear(self) -> None:
        """In a new map nothing was driven yet."""
        del self._stamps[:], self._poses[:]

    def arrays(self) -> tuple[NDArray[np.int64], Floats]:
        """Stamps (N,) in ns, and poses (N, 3): x, y, m, and yaw, rad, in odom."""
        return np.array(self._stamps, np.int64), np.array(self._poses).reshape(-1, 3)
