"""Dead reckoning from rear-wheel speed and yaw rate, and the poses it remembers."""

from __future__ import annotations

from bisect import bisect_right

import msgspec

from echogrid.core.messages import EgoMotion, Speed, YawRate
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.core.motion.se2 import IDENTITY, SE2
from echogrid.core.motion.standstill import Standstill

NS = 1e-9
STANDSTILL = 0.02  # m/s: below, the wheels stand still and the yaw rate is only bias and noise


class EgoState(msgspec.Struct, frozen=True):
    """Where the car is and how it moves at `stamp_ns`; the yaw rate is 0 while the wheels stand still."""

    stamp_ns: int
    odom_from_base: SE2
    speed: float  # m/s
    yaw_rate: float  # rad/s


class Odometry:
    """Remembers the newest speed and yaw rate, and the states of the last `history` seconds.

    Each sample ends an arc on which speed and yaw rate have the mean of their values at its ends, without what `errors` knows them to be
    off by. While the wheels stand, yaw is frozen. Before both were seen once there is no pose. A value of one kind is held for `max_hold`
    after its last sample, then there is no pose until it is back. A silence longer than `max_gap` is not bridged: the pose stays where it
    was, and `gaps` counts it.
    """

    def __init__(
        self,
        errors: ErrorFilter | None = None,
        history: float = 2.0,
        max_gap: float = 0.5,
        max_extrapolation: float = 0.1,
        max_hold: float = 0.2,
    ) -> None:
        self.errors = ErrorFilter(()) if errors is None else errors
        self.history_ns = round(history / NS)
        self.max_gap_ns = round(max_gap / NS)
        self.max_extrapolation_ns = round(max_extrapolation / NS)
        self.max_hold_ns = round(max_hold / NS)
        self.speed: Speed | None = None
        self.yaw_rate: YawRate | None = None
        self.states: list[EgoState] = []
        self._stamps: list[int] = []  # theirs
        self.distance = 0.0  # m, travelled, forward and backward alike
        self.gaps = 0
        self.standstill = Standstill()

    def add(self, motion: EgoMotion) -> bool:
        """Moves to the sample's time. False, and nothing changes, where the sample is not newer than the last of its kind.

        The two kinds may have different latencies: a sample older than the newest state only replaces its value.
        """
        speed, yaw_rate = self.speed, self.yaw_rate
        if isinstance(motion, Speed):
            if speed is not None and motion.stamp_ns <= speed.stamp_ns:
                return False
            self.speed = speed = motion
        else:
            if yaw_rate is not None and motion.stamp_ns <= yaw_rate.stamp_ns:
                return False
            self.yaw_rate = yaw_rate = motion
            standing = speed is not None and -STANDSTILL < speed.speed < STANDSTILL
            stood = self.standstill.add(motion.stamp_ns, motion.yaw_rate, standing=standing)
            if stood is not None:
                self.errors.stood(*stood)
        if speed is not None and yaw_rate is not None and -self.max_hold_ns <= speed.stamp_ns - yaw_rate.stamp_ns <= self.max_hold_ns:
            self._move(motion.stamp_ns, speed, yaw_rate.yaw_rate)
        return True

    def restart(self) -> None:
        """There is no pose until speed and yaw rate are known again, and then it is the identity. What was learned of them stays."""
        self.speed = self.yaw_rate = None
        self.states, self._stamps = [], []
        self.standstill.restart()
        self.errors.restart()

    def at(self, stamp_ns: int) -> EgoState | None:
        """The state at a time: on the arc between two samples, or a little past the newest. None outside."""
        index = bisect_right(self._stamps, stamp_ns)
        if index == 0:
            return None
        before = self.states[index - 1]
        step_ns = stamp_ns - before.stamp_ns
        if index == len(self.states):
            if step_ns > self.max_extrapolation_ns:
                return None
            pose = before.odom_from_base.ahead(before.speed * step_ns * NS, before.yaw_rate * step_ns * NS)
            return EgoState(stamp_ns, pose, before.speed, before.yaw_rate)
        after = self.states[index]
        length_ns = after.stamp_ns - before.stamp_ns
        if length_ns > self.max_gap_ns:
            return None
        share, speed, yaw_rate = step_ns / length_ns, (before.speed + after.speed) / 2, (before.yaw_rate + after.yaw_rate) / 2
        pose = before.odom_from_base.ahead(speed * step_ns * NS, yaw_rate * step_ns * NS)
        return EgoState(
            stamp_ns,
            pose,
            before.speed + share * (after.speed - before.speed),
            before.yaw_rate + share * (after.yaw_rate - before.yaw_rate),
        )

    def _move(self, stamp_ns: int, wheels: Speed, gyro: float) -> None:
        speed, yaw_rate = self.errors.corrected(wheels.speed, gyro)
        if -STANDSTILL < wheels.speed < STANDSTILL:
            yaw_rate = 0.0
        states, stamps, pose = self.states, self._stamps, IDENTITY
        if states:
            before = states[-1]
            pose, step_ns = before.odom_from_base, stamp_ns - before.stamp_ns
            if step_ns <= 0:
                return
            if step_ns > self.max_gap_ns:
                self.gaps += 1
            else:
                begin, mean_speed, mean_rate = pose, (before.speed + speed) / 2, (before.yaw_rate + yaw_rate) / 2
                pose = begin.ahead(mean_speed * step_ns * NS, mean_rate * step_ns * NS)
                self.distance += abs(mean_speed) * step_ns * NS
                self.errors.travel(begin, pose, step_ns * NS, wheels.speed, gyro, wheels.difference)
        states.append(EgoState(stamp_ns, pose, speed, yaw_rate))
        stamps.append(stamp_ns)
        if stamp_ns - stamps[0] > 2 * self.history_ns:  # cut in large pieces: cutting a list moves all of it
            keep = bisect_right(stamps, stamp_ns - self.history_ns)
            del states[: keep - 1], stamps[: keep - 1]
