"""What a pose from outside means by its heading and axes: weighed against the car's own motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from echogrid.core.kernels.cells import once
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2

STEP = 0.02  # s of dead reckoning
LEG, LEGS, WINDOW = 3.0, 12, 40  # m between two places that are compared; how many at least; and how many before dead reckoning drifts
AGREES = 0.8  # share of the way that one rotation explains
BETTER = 0.1  # and by so much more than the mirrored one, or the other way round
TURNED = math.radians(30.0)  # less tells nothing of signs and units
TURNS, COARSE = 20, 1.0  # steps in which a heading that is 57.3 times too large turns by more than this, rad
SURE = 0.85  # rad, root mean square, that these steps may be off; chance is 1.8
DEGREES = math.degrees(1.0)


@dataclass(frozen=True, slots=True)
class Convention:
    """`mirrored`: places go the other way round than the car. Else the car's true yaw is `factor` x the told one + `offset` (rad), to
    within `scatter` (rad); `as_told` (rad) with factor 1, and `apart` (rad) in the mean. `turned` (rad): how far the car did."""

    mirrored: bool
    factor: float
    offset: float
    scatter: float
    as_told: float
    apart: float
    turned: float


def convention(motion: Floats, told: Floats, point: SE2) -> Convention | None:
    """motion (T, 3): s, m/s, rad/s; told (N, 5), in order of their times: s, x and y in m, s of the yaw, yaw in rad. `point` in base.

    None where places that fit the way are too few.
    """
    if len(motion) < 2 or len(told) < LEGS:
        return None
    time = np.arange(motion[0, 0], motion[-1, 0], STEP)
    speed, yaw_rate = (np.interp(time, motion[:, 0], motion[:, n]) for n in (1, 2))
    yaw = np.cumsum(yaw_rate) * STEP
    path, way = np.cumsum(speed * np.exp(1j * yaw)) * STEP, np.cumsum(np.abs(speed)) * STEP
    told = told[(told[:, [0, 3]].min(axis=1) >= time[0]) & (told[:, [0, 3]].max(axis=1) <= time[-1])] if len(time) else told[:0]
    if len(told) < LEGS:
        return None
    turned = np.interp(told[:, 3], time, yaw)
    at = np.interp(told[:, 0], time, path) + complex(point.x, point.y) * np.exp(1j * np.interp(told[:, 0], time, yaw))
    driven = np.interp(told[:, 0], time, way)
    legs = once(np.searchsorted(driven, np.arange(driven[0], driven[-1], LEG)))
    if len(legs) <= LEGS:
        return None
    moved, reckoned = np.diff(told[legs, 1] + 1j * told[legs, 2]), np.diff(at[legs])
    begins = range(0, len(moved) - LEGS + 1, WINDOW)
    windows = [slice(begin, begin + WINDOW) for begin in begins]
    same, other = (np.array([np.vdot(one[part], moved[part]) for part in windows]) for one in (reckoned, reckoned.conj()))
    whole = sum(float(np.sum(np.abs(moved[part]) * np.abs(reckoned[part]))) for part in windows)
    straight, mirrored = np.abs(same).sum() / max(whole, 1e-9), np.abs(other).sum() / max(whole, 1e-9)
    range_ = float(np.ptp(turned))
    if mirrored > max(straight + BETTER, AGREES):
        return Convention(True, 1.0, 0.0, 0.0, 0.0, 0.0, range_)
    if straight < AGREES:
        return None
    window = np.clip(np.searchsorted(legs, np.arange(len(told)), side="right") // WINDOW, 0, len(windows) - 1)
    true, shown = turned + np.angle(same)[window], told[:, 4] - point.yaw
    apart, as_told = _circular(true - shown)
    fits = {factor: _circular(true - factor * shown) for factor in (1.0, -1.0, DEGREES, -DEGREES)}
    factor = min(fits, key=lambda one: fits[one][1])
    offset, scatter = fits[factor]
    for sign in (1.0, -1.0):
        if _coarse(turned, sign * shown):
            factor, offset, scatter = sign / DEGREES, 0.0, 0.0
    return Convention(False, factor, offset, scatter, as_told, apart, range_)


def _circular(angles: Floats) -> tuple[float, float]:
    """Mean and standard deviation, rad."""
    mean = complex(np.exp(1j * angles).mean())
    return math.atan2(mean.imag, mean.real), math.sqrt(max(-2.0 * math.log(max(abs(mean), 1e-12)), 0.0))


def _coarse(turned: Floats, shown: Floats) -> bool:
    """Whether a heading in degrees was taken for radians: from one to the next it turns by 57.3 times as much as the car, wrapped."""
    expected = DEGREES * np.diff(turned)
    turns = np.abs(expected) > COARSE
    left = np.angle(np.exp(1j * (np.diff(shown) - expected)[turns]))
    return bool(np.count_nonzero(turns) >= TURNS and np.sqrt(np.mean(left**2)) < SURE)
