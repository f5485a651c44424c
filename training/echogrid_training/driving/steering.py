"""The line a car really takes when its driver follows another line: smooth, no tighter than it can turn, base never slipping sideways."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.streets.shapes import resample

STEP = 0.1  # m, of a course
TIGHTEST = 1 / 5.4  # 1/m, of base: a mid-size car at full lock


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Driven without a change of direction from `start` on: the turn per metre travelled at points every STEP m, linear between them."""

    start: SE2
    reverse: bool
    curvature: Floats  # (N,) rad of yaw per m travelled, in reverse too
    progress: Floats  # (N,) m along the line that was followed
    end: SE2

    @property
    def length(self) -> float:
        return STEP * (len(self.curvature) - 1)


def follow(
    start: SE2, line: Floats, reverse: bool = False, lookahead: float = 3.5, agility: float = 0.07, tightest: float = TIGHTEST
) -> Course:
    """Pure pursuit of a line (N, 2) m to its end by base; `agility` is the fastest change of curvature per m, `tightest` the largest, 1/m.

    The wheels may be turned before the car starts, so the curvature begins with any value.
    """
    fine = resample(line, 0.25)
    spacing = float(np.hypot(*(fine[1] - fine[0])))
    over = fine[-1] - fine[-2]  # beyond its end the line goes straight on, for the look ahead
    beyond = fine[-1] + over * np.arange(1, math.ceil(lookahead / spacing) + 1)[:, None]
    points = np.concatenate((fine, beyond)).tolist()
    x, y, yaw = start.x, start.y, start.yaw + (math.pi if reverse else 0.0)  # of the motion: reversing is driving the other way round
    target, last, turn = 0, len(points) - 1, math.nan
    curvature: list[float] = []
    progress: list[float] = []
    most = 3 * len(points)
    while target < last and len(curvature) < most:
        while target < last and math.hypot(points[target][0] - x, points[target][1] - y) < lookahead:
            target += 1
        dx, dy = points[target][0] - x, points[target][1] - y
        wanted = 2.0 * (math.cos(yaw) * dy - math.sin(yaw) * dx) / max(dx * dx + dy * dy, 1e-6)
        wanted = min(max(wanted, -tightest), tightest)
        change = agility * STEP
        before = wanted if math.isnan(turn) else turn
        turn = min(max(wanted, before - change), before + change)
        bend = (before + turn) / 2 * STEP
        x += STEP * math.cos(yaw + bend / 2)
        y += STEP * math.sin(yaw + bend / 2)
        yaw += bend
        if not curvature:
            curvature.append(before)
            progress.append(max(0.0, target * spacing - lookahead))
        curvature.append(turn)
        progress.append(max(progress[-1], target * spacing - lookahead))
    return Course(start, reverse, np.array(curvature), np.array(progress), SE2(x, y, yaw - (math.pi if reverse else 0.0)))
