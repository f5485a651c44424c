"""The way a generated car drives: legs of constant change of speed and yaw rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import IDENTITY, SE2, arc

STEP = 0.001  # s, of the integration


@dataclass(frozen=True, slots=True)
class Leg:
    """For `seconds`, speed (m/s) and yaw rate (rad/s) change at constant rates from those of the leg before to these."""

    seconds: float
    speed: float
    yaw_rate: float = 0.0


class Path:
    """Poses and motion of base over time; it starts at `start` with `speed` and no yaw rate."""

    def __init__(self, legs: Sequence[Leg], start: SE2 = IDENTITY, speed: float = 0.0) -> None:
        self._knots = np.concatenate(([0.0], np.cumsum([leg.seconds for leg in legs])))
        self._speeds = np.array([speed, *(leg.speed for leg in legs)])
        self._yaw_rates = np.array([0.0, *(leg.yaw_rate for leg in legs)])
        self.duration = float(self._knots[-1])  # s
        self._poses = [start]
        middles: Floats = (np.arange(math.ceil(self.duration / STEP), dtype=np.float64) + 0.5) * STEP
        for step_speed, step_rate in zip(*self.motion(middles), strict=True):
            self._poses.append(self._poses[-1] @ arc(float(step_speed) * STEP, float(step_rate) * STEP))

    def motion(self, times: Floats) -> tuple[Floats, Floats]:
        """Speed (N,) m/s and yaw rate (N,) rad/s at times (N,) s; before and after the path they are those of its ends."""
        return np.interp(times, self._knots, self._speeds), np.interp(times, self._knots, self._yaw_rates)

    def pose(self, time: float) -> SE2:
        """`world_from_base` at a time (s) within the path."""
        step = min(int(time / STEP), len(self._poses) - 1)
        rest = time - step * STEP
        speed, yaw_rate = self.motion(np.array([time - rest / 2]))
        return self._poses[step] @ arc(float(speed[0]) * rest, float(yaw_rate[0]) * rest)
