"""What the car's sensors are off by, learned while it drives, and how well its pose is known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion import error_model as model
from echogrid.core.motion.error_model import BIAS, DELAY, HEADING, POSE, SCALE, TRACK, TURN_SCALE, UNEVEN, X, Y
from echogrid.core.motion.leg import Leg
from echogrid.core.motion.se2 import SE2

STEP = 0.1  # s: the covariance goes on in steps of so much
WINDOW = 1.0  # s over which the wheels' difference is compared with the gyro
SLOWEST = 1.0  # m/s: slower wheels are not compared
TELLING, MOST_VOTES = 0.04, 3  # m/s that a change of the yaw rate makes of the wheels' difference, to tell whether both go together
FARTHEST = 4.0  # sigmas: what is farther off is no measurement
UNSURE, SURE = 1.5, 2.0  # sigmas: of an estimate up to which nothing is taken off, and from which on all of it
MOTION = slice(SCALE, TURN_SCALE + 1)  # scale, bias and turn scale: what the motion itself is off by
SMOOTHED = 0.2  # s over which accelerations are taken

Learns = Literal["driving", "standing", "never"]


class Certainty(msgspec.Struct, frozen=True, eq=False):
    """Covariances of the pose (3, 3), x, y (m) and yaw (rad) in odom, and of the motion (2, 2), speed (m/s) and yaw rate (rad/s)."""

    pose: Floats
    motion: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """Mean (E,) and covariance (E, E) of all errors but the pose's, as they were at the end of a drive."""

    mean: Floats
    covariance: Floats


class ErrorFilter:
    """Remembers mean and covariance of all errors (core/motion/error_model.py) together with those of the pose.

    A Kalman filter. What is learned holds from then on: the pose itself is never moved (it drifts, it never jumps), so the mean of its
    error says how far it is off by now, and `certainty` counts that in. Of scale and bias only what is surely not 0 is taken off.
    """

    def __init__(self, radars: Sequence[str], learns: Learns = "driving") -> None:
        self.radars = tuple(radars)
        self.learns = learns
        self.places = model.places(radars)
        self.mean, self.covariance = model.prior(len(radars))
        self.scale = self.bias = 0.0  # what is taken off: a share, rad/s
        self.acceleration = self.turn_acceleration = 0.0  # m/s², rad/s²
        self._walk = model.wandering(len(radars))
        self._most = model.most(len(radars))
        self._still = np.eye(len(self.mean))  # what a leg of no length makes of all errors
        self._smooth: tuple[float, float] | None = None
        self._unseen = 0.0  # rad that the car turned while its wheels showed 0
        self._leg: Leg | None = None
        self._window: Leg | None = None
        self._turning = 0.0  # rad/s, of its first leg
        self._wheels_differ = False
        self._before: tuple[float, float] | None = None  # yaw rate and difference of the last window
        self._votes = 0  # windows in which the wheels' difference changed with the yaw rate, less those in which it did not

    def restart(self) -> None:
        """The pose begins anew; what was learned stays."""
        self.mean[:POSE] = 0.0
        self.covariance[:POSE] = 0.0
        self.covariance[:, :POSE] = 0.0
        self._leg, self._window, self._smooth, self._unseen = None, None, None, 0.0

    def keep(self) -> Kept:
        """For another drive of the same car."""
        return Kept(self.mean[POSE:].copy(), self.covariance[POSE:, POSE:].copy())

    def recall(self, kept: Kept, *, same_drive: bool = False) -> None:
        """At the begin of a drive: what was kept of the last one. Since then the errors have wandered, unless it was the same drive."""
        self.mean[POSE:] = kept.mean
        rest = 0.0 if same_drive else model.resting(len(self.radars))[POSE:, POSE:]
        self.covariance[POSE:, POSE:] = kept.covariance + rest
        self._bound()
        self.scale, self.bias = self._sure(SCALE), self._sure(BIAS)

    def corrected(self, speed: float, yaw_rate: float) -> tuple[float, float]:
        """m/s and rad/s of wheels and gyro without what they are surely off by."""
        return speed * (1.0 + self.scale), yaw_rate - self.bias

    def certainty(self, speed: float, yaw_rate: float) -> Certainty:
        """At the newest pose, while the car moves like this (m/s, rad/s, corrected)."""
        mean, covariance = self.mean, self.covariance
        pose = covariance[:POSE, :POSE] + mean[:POSE, None] * mean[:POSE]
        (scales, with_bias, with_turn), (_, biases, bias_turn), (_, _, turns) = covariance[MOTION, MOTION].tolist()
        scale, bias, turn_scale = mean[MOTION].tolist()  # the speed is off by speed * scale, the yaw rate by yaw_rate * turn_scale - bias
        wheels, gyro = speed * (scale - self.scale), yaw_rate * turn_scale - (bias - self.bias)
        both = speed * (yaw_rate * with_turn - with_bias) + wheels * gyro
        turning = yaw_rate * (yaw_rate * turns - 2 * bias_turn) + biases + gyro**2
        motion = np.array(((speed**2 * scales + wheels**2 + model.WHEEL_NOISE**2, both), (both, turning + model.GYRO_NOISE**2)))
        return Certainty(pose, motion)

    def learned(self) -> dict[str, float]:
        """For reports, in percent, degrees, degrees/s and metres: each estimate with its `_sigma`, and what is `_applied` of it."""
        degree = math.degrees(1.0)
        named = {"wheel_scale_percent": (SCALE, 100.0), "yaw_rate_bias_deg_s": (BIAS, degree), "track_m": (TRACK, 1.0)}
        named |= {"uneven_wheels_percent": (UNEVEN, 100.0), "delay_ms": (DELAY, 1000.0)}
        named |= {f"mount_yaw_deg.{radar}": (place + model.YAW, degree) for radar, place in self.places.items()}
        report = {"wheel_scale_percent_applied": 100.0 * self.scale, "yaw_rate_bias_deg_s_applied": degree * self.bias}
        for name, (place, unit) in named.items():
            report |= {name: unit * float(self.mean[place]), f"{name}_sigma": unit * math.sqrt(float(self.covariance[place, place]))}
        return {name: round(value, 4) for name, value in sorted(report.items())}

    def travel(self, before: SE2, after: SE2, seconds: float, speed: float, yaw_rate: float, difference: float) -> None:
        """The pose went along an arc, on which wheels and gyro said this (m/s, rad/s, m/s), uncorrected."""
        leg = self._leg
        if leg is None:
            leg = self._leg = Leg(before)
        leg.seconds += seconds
        leg.speed += seconds * speed
        leg.yaw_rate += seconds * yaw_rate
        leg.difference += seconds * difference
        if leg.seconds >= STEP:
            self._leg = None
            self._accelerate(leg)
            self._spread(leg, after)
            self._compare(leg)

    def stood(self, seconds: float, yaw_rate: float) -> None:
        """The gyro's mean (rad/s) over so many seconds in which the car surely stood."""
        if self.learns != "never":
            self._observe({BIAS: 1.0}, yaw_rate - self.mean[BIAS], model.STANDING_NOISE**2 / seconds, farthest=math.inf)

    def see(self, information: Floats, vector: Floats, moves: Sequence[int]) -> None:
        """A measurement in information form, (E, E) and (E,) over all errors: Hᵀ R⁻¹ H and Hᵀ R⁻¹ (measured - expected).

        It moves no other errors than these: the others are considered, not estimated (docs/motion.md has what it did to them).
        """
        gain = np.zeros_like(self.covariance)
        rows = list(moves)
        gain[rows] = np.linalg.solve(self._still + self.covariance @ information, self.covariance)[rows]
        gained = gain @ information
        self._update(gained, gained @ gain.T, gain @ vector)

    def _not_applied(self) -> Floats:
        """(E,) the mean of what is left."""
        left = self.mean.copy()
        left[SCALE] -= self.scale
        left[BIAS] -= self.bias
        return left

    def _accelerate(self, leg: Leg) -> None:
        speed, yaw_rate = leg.speed / leg.seconds, leg.yaw_rate / leg.seconds
        old_speed, old_rate = (speed, yaw_rate) if self._smooth is None else self._smooth
        self.acceleration, self.turn_acceleration = (speed - old_speed) / SMOOTHED, (yaw_rate - old_rate) / SMOOTHED
        share = min(leg.seconds / SMOOTHED, 1.0)
        self._smooth = old_speed + share * (speed - old_speed), old_rate + share * (yaw_rate - old_rate)

    def _spread(self, leg: Leg, after: SE2) -> None:
        """Mean and covariance after a leg."""
        dx, dy = after.x - leg.begin.x, after.y - leg.begin.y
        seconds, turn = leg.seconds, leg.yaw_rate
        step = self._still.copy()
        step[X, HEADING], step[Y, HEADING] = -dy, dx
        step[X, SCALE], step[Y, SCALE] = dx / (1.0 + self.scale), dy / (1.0 + self.scale)
        length = math.hypot(dx, dy)
        if length > 0.0:  # else the car stands, and its yaw is frozen
            step[HEADING, BIAS], step[HEADING, TURN_SCALE] = -seconds, turn
            step[X, BIAS], step[Y, BIAS] = dy * seconds / 2, -dx * seconds / 2
            step[X, TURN_SCALE], step[Y, TURN_SCALE] = -dy * turn / 2, dx * turn / 2
        self.mean[:POSE] = step[:POSE] @ self._not_applied()
        self.covariance = step @ self.covariance @ step.T + self._walk * seconds
        self._bound()
        if length == 0.0:
            self._creep(leg)
            return
        self._unseen = 0.0
        x, y = dx / length, dy / length
        along, side = model.ALONG_NOISE**2 * length, model.SIDE_NOISE**2 * length
        mixed, covariance = (along - side) * (x * y), self.covariance
        covariance[X, X] += side + (along - side) * (x * x)
        covariance[X, Y] += mixed
        covariance[Y, X] += mixed
        covariance[Y, Y] += side + (along - side) * (y * y)
        covariance[HEADING, HEADING] += model.HEADING_NOISE**2 * seconds + model.TURN_NOISE**2 * abs(turn)

    def _bound(self) -> None:
        """However long nothing was learned of an error, as by a car that stands for days: it is not as large as one likes."""
        over = (self.covariance.diagonal() > self._most).nonzero()[0]
        if len(over):
            shrink = np.ones(len(self.mean))
            shrink[over] = np.sqrt(self._most[over] / self.covariance.diagonal()[over])
            self.covariance *= shrink[:, None] * shrink

    def _creep(self, leg: Leg) -> None:
        """Wheels that show 0 while the gyro turns: nobody knows how far the car went, and the yaw is frozen."""
        turn = leg.yaw_rate - float(self.mean[BIAS]) * leg.seconds
        if abs(turn) < model.CREEPING * leg.seconds:
            return
        before, self._unseen = self._unseen, self._unseen + turn
        self.covariance[HEADING, HEADING] += max(self._unseen**2 - before**2, 0.0)
        self.covariance[X, X] += model.CREPT**2 * leg.seconds
        self.covariance[Y, Y] += model.CREPT**2 * leg.seconds

    def _compare(self, leg: Leg) -> None:
        """The wheels' difference with the gyro, over a window of legs: a bias is there at any speed, uneven wheels grow with it."""
        self._wheels_differ |= leg.difference != 0.0  # else both wheels are one and the same signal
        if self.learns != "driving" or not self._wheels_differ or abs(leg.speed) < SLOWEST * leg.seconds:
            self._window = None
            return
        turning, whole = leg.yaw_rate / leg.seconds, self._window
        if whole is None:
            whole, self._turning = Leg(leg.begin), turning
        whole.join(leg)
        if whole.seconds < WINDOW - STEP / 2:
            self._window = whole
            return
        self._window = None
        speed, yaw_rate, difference = (value / whole.seconds for value in (whole.speed, whole.yaw_rate, whole.difference))
        change = (turning - self._turning) / whole.seconds
        if not self._go_together(yaw_rate, difference):
            return
        track, turned = float(self.mean[TRACK]), yaw_rate * (1.0 + float(self.mean[TURN_SCALE])) - float(self.mean[BIAS])
        slope = {BIAS: -track, TURN_SCALE: track * yaw_rate, TRACK: turned, UNEVEN: speed}
        left = difference - track * turned - float(self.mean[UNEVEN]) * speed
        self._observe(slope, left, model.DIFFERENCE_NOISE**2 + (track * model.DIFFERENCE_DELAY * change) ** 2)

    def _go_together(self, yaw_rate: float, difference: float) -> bool:
        """Whether the right wheel is the faster one to the left: of wheels that are mixed up nothing is learned."""
        before, self._before = self._before, (yaw_rate, difference)
        if before is not None:
            turn, apart = yaw_rate - before[0], difference - before[1]
            if abs(float(self.mean[TRACK]) * turn) > TELLING:
                self._votes = max(-MOST_VOTES, min(self._votes + (1 if turn * apart > 0.0 else -1), MOST_VOTES))
        return self._votes >= 0

    def _observe(self, slope: Mapping[int, float], left: float, variance: float, farthest: float = FARTHEST) -> None:
        """One number that differs by `left` from the expected one, unless that is too many sigmas to be a measurement."""
        h = np.zeros(len(self.mean))
        h[list(slope)] = list(slope.values())
        along = self.covariance @ h
        total = float(h @ along) + variance
        if left * left > farthest**2 * total:
            return
        gain = along / total
        self._update(np.outer(gain, h), variance * np.outer(gain, gain), gain * left)

    def _update(self, gained: Floats, noise: Floats, moved: Floats) -> None:
        """Joseph's form, which holds for whatever gain."""
        rest = self._still - gained
        covariance = rest @ self.covariance @ rest.T + noise
        self.covariance = (covariance + covariance.T) / 2
        self.mean += moved
        self.scale, self.bias = self._sure(SCALE), self._sure(BIAS)

    def _sure(self, place: int) -> float:
        value = float(self.mean[place])
        sigmas = abs(value) / math.sqrt(float(self.covariance[place, place]))
        return value * min(max((sigmas - UNSURE) / (SURE - UNSURE), 0.0), 1.0)
