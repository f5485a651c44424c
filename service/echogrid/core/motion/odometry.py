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
            standing = speed is not None and abs(speed.speed) < STANDSTILL
            stood = self.standstill.add(motion.stamp_ns, motion.yaw_rate, standing=standing)
            if stood is not None:
                self.errors.stood(*stood)
        if speed is not None and yaw_rate is not None and abs(speed.stamp_ns - yaw_rate.stamp_ns) <= self.max_hold_ns:
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
            return EgoState(stamp_ns, _ahead(before, before.speed, before.yaw_rate, step_ns), before.speed, before.yaw_rate)
        after = self.states[index]
        length_ns = after.stamp_ns - before.stamp_ns
        if length_ns > self.max_gap_ns:
            return None
        share = step_ns / length_ns
        pose = _ahead(before, (before.speed + after.speed) / 2, (before.yaw_rate + after.yaw_rate) / 2, step_ns)
        return EgoState(
            stamp_ns,
            pose,
            before.speed + share * (after.speed - before.speed),
            before.yaw_rate + share * (after.yaw_rate - before.yaw_rate),
        )

    def _move(self, stamp_ns: int, wheels: Speed, gyro: float) -> None:
        speed, yaw_rate = self.errors.corrected(wheels.speed, gyro)
        if abs(wheels.speed) < STANDSTILL:
            yaw_rate = 0.0
        if not self.states:
            self._keep(EgoState(stamp_ns, IDENTITY, speed, yaw_rate))
            return
        before = self.states[-1]
        step_ns = stamp_ns - before.stamp_ns
        if step_ns <= 0:
            return
        pose = before.odom_from_base
        if step_ns > self.max_gap_ns:
            self.gaps += 1
        else:
            mean_speed = (before.speed + speed) / 2
            pose = _ahead(before, mean_speed, (before.yaw_rate + yaw_rate) / 2, step_ns)
            self.distance += abs(mean_speed) * step_ns * NS
            self.errors.travel(before.odom_from_base, pose, step_ns * NS, wheels.speed, gyro, wheels.difference)
        self._keep(EgoState(stamp_ns, pose, speed, yaw_rate))
        if stamp_ns - self._stamps[0] > 2 * self.history_ns:  # cut in large pieces: cutting a list moves all of it
            keep = bisect_right(self._stamps, stamp_ns - self.history_ns)
            del self.states[: keep - 1], self._stamps[: keep - 1]

    def _keep(self, state: EgoState) -> None:
        self.states.append(state)
        self._stamps.append(state.stamp_ns)


def _ahead(before: EgoState, speed: float, yaw_rate: float, step_ns: int) -> SE2:
    """`odom_from_base` after `step_ns` of this motion: an exact arc."""
    return before.odom_from_base.ahead(speed * step_ns * NS, yaw_rate * step_ns * NS)
