"""Whether ego motion can be trusted: each sample by what a car can do, and all of it by what the radars see."""

from __future__ import annotations

import math
from enum import Enum

from echogrid.core.messages import EgoMotion, Speed
from echogrid.core.motion.odometry import STANDSTILL
from echogrid.core.radar.doppler_motion import DopplerMotion

NS = 1e-9
MAX_GAP_NS = 500_000_000  # a silence that is longer cannot be bridged: where the car went in it is not known
SILENT_NS = 300_000_000
OLD_RUN = 5  # samples in a row that are not newer than the last: no reordering, the clock was set back
NOTED_NS = 1_000_000_000  # how long an implausible sample stays a reason
LONGEST_STEP = 0.1  # s: a longer one allows no greater jump
FASTEST = 100.0  # m/s
ACCELERATION, SPEED_NOISE = 15.0, 1.0  # m/s², m/s: between two samples a car changes its speed by no more
YAW_ACCELERATION, YAW_NOISE = 4.0, 0.3  # rad/s², rad/s
TURNING = 3.0  # rad/s: nothing on four wheels turns faster
SETTLING = 0.6  # s over which the radars' motion is compared
OFF_SPEED, OFF_SHARE, OFF_YAW_RATE = 0.5, 0.05, 0.2  # m/s, of the speed, rad/s: from where on, on average, motion is disputed
STUCK = 0.5  # s without the smallest change
STUCK_SPEED, STUCK_YAW_RATE = 0.35, 0.15  # share of that difference which then is enough, from MOVING m/s on
MOVING, CREEPING = 1.0, 1.2  # m/s: wheels may read 0 up to a walking pace
AGREED = 0.5  # share of that difference below which it is not disputed any more
MOST = 2.0  # of that difference, which one comparison can show
BETTER = 1.5  # so many times as many detections must fit what differs by more
SUPPORT = 0.5  # share of the detections that must support another motion
BROAD = 0.1  # breadth that they must have: ahead alone, traffic that goes along outvotes what stands


class Verdict(Enum):
    """On one sample."""

    GOOD = "good"
    OLD = "not newer than the last of its kind"
    IMPLAUSIBLE = "no car moves like that"
    GAP = "the first sample after too long a silence"
    JUMP = "time has jumped"
    BACK = "the clock was set back"


# A member by its class costs ten times as much as a name, and each sample asks for several.
GOOD, OLD, IMPLAUSIBLE, GAP, JUMP, BACK = Verdict


class SampleWatch:
    """Remembers the last good samples of one kind of motion. `name` and `unit` are for sentences."""

    def __init__(self, name: str, unit: str, most: float, rate: float, noise: float, stuck_share: float) -> None:
        self.name, self.unit, self.stuck_share = name, unit, stuck_share
        self.most, self.rate, self.noise = most, rate, noise
        self.last_ns: int | None = None
        self.last = math.nan
        self.implausible_ns: int | None = None
        self.implausible = math.nan  # the newest such value
        self.changed_ns = 0
        self._behind = 0

    def judge(self, stamp_ns: int, value: float) -> Verdict:
        """A good sample becomes the last one; after GAP or BACK the caller starts a new map and calls `restart`."""
        last_ns, last, jumps = self.last_ns, self.last, False
        if last_ns is not None:
            if stamp_ns <= last_ns:
                self._behind += 1
                return BACK if self._behind >= OLD_RUN else OLD
            if stamp_ns - last_ns > MAX_GAP_NS:
                self._behind = 0
                return GAP
            jumps = abs(value - last) > self.noise + self.rate * min((stamp_ns - last_ns) * NS, LONGEST_STEP)
        self._behind = 0
        if jumps or abs(value) > self.most:
            self.implausible_ns, self.implausible = stamp_ns, value
            return IMPLAUSIBLE
        if last_ns is None or value != last:
            self.changed_ns = stamp_ns
        self.last_ns, self.last = stamp_ns, value
        return GOOD

    @property
    def is_stuck(self) -> bool:
        """Whether the sensor has said the same for longer than one does."""
        return self.last_ns is not None and (self.last_ns - self.changed_ns) * NS > STUCK

    def patience(self, moves: bool) -> float:
        """With how much of a difference from what the radars see, as a share of what is too much; less while the car moves."""
        return self.stuck_share if moves and self.is_stuck else 1.0

    @property
    def jumped(self) -> bool:
        """Whether the newest sample was implausible."""
        implausible_ns, last_ns = self.implausible_ns, self.last_ns
        return implausible_ns is not None and (last_ns is None or implausible_ns > last_ns)

    def silence(self, now_ns: int) -> str | None:
        """A sentence if there is no good sample, or none any more."""
        last_ns = self.last_ns  # read once: another thread may be asking while `restart` takes it away
        if last_ns is not None and now_ns - last_ns <= SILENT_NS:
            return None
        if self.jumped:
            return f"{self.name}: jumps to {self.implausible:.1f} {self.unit}"
        return f"{self.name}: nothing so far" if last_ns is None else f"{self.name}: silent for {(now_ns - last_ns) * NS:.1f} s"

    def note(self, now_ns: int) -> str | None:
        """A sentence if an implausible sample was left out recently."""
        implausible_ns = self.implausible_ns
        if implausible_ns is None or now_ns - implausible_ns > NOTED_NS:
            return None
        return f"{self.name}: jumps to {self.implausible:.1f} {self.unit}"

    def restart(self) -> None:
        """Forgets all that has a time."""
        self.last_ns = self.implausible_ns = None
        self._behind = 0


class MotionWatch:
    """Remembers both kinds of samples, and how far they were off recently from what the radars see."""

    def __init__(self) -> None:
        self.speed = SampleWatch("wheel speed", "m/s", FASTEST, ACCELERATION, SPEED_NOISE, STUCK_SPEED)
        self.yaw_rate = SampleWatch("yaw rate", "rad/s", TURNING, YAW_ACCELERATION, YAW_NOISE, STUCK_YAW_RATE)
        self.disputed: str | None = None  # a sentence while the radars measure another motion
        self._off = (0.0, 0.0)  # mean difference of speed and yaw rate, as shares of what is too much
        self._compared_ns: int | None = None

    def judge(self, motion: EgoMotion) -> Verdict:
        if not motion.continues and self.speed.last_ns is not None:
            return JUMP
        watch, value = (self.speed, motion.speed) if isinstance(motion, Speed) else (self.yaw_rate, motion.yaw_rate)
        verdict = watch.judge(motion.stamp_ns, value)
        if verdict is GAP and watch.jumped:  # whether it is right now, or was before, the radars must say
            self.disputed = f"{watch.name}: jumped to {value:.1f} {watch.unit}"
            self._off = MOST, MOST
        return verdict

    def compare(self, stamp_ns: int, speed: float, yaw_rate: float, support: float, seen: DopplerMotion | None) -> bool:
        """Ego motion at a time, the share of detections that fit it, and what the radars see (None: nothing).

        Returns whether the two differ too much now.

        `disputed` is set when they differ so much on average, and ends when they no longer do, or when both say that the car stands. It
        tells the values of a time at which they differed.
        """
        if seen is None or seen.support < SUPPORT or seen.breadth < BROAD:
            return False
        step = 0.0 if self._compared_ns is None else min(max(stamp_ns - self._compared_ns, 0) * NS, LONGEST_STEP)
        self._compared_ns = stamp_ns
        share = 1.0 - math.exp(-step / SETTLING)
        pace = abs(speed)
        too_fast = (seen.speed - speed) / (OFF_SPEED + OFF_SHARE * pace if pace > STANDSTILL else CREEPING)
        too_turned = (seen.yaw_rate - yaw_rate) / OFF_YAW_RATE
        apart = max(abs(too_fast), abs(too_turned))
        if apart > MOST and seen.support < BETTER * support:  # two swapped radars can outvote two good ones
            return False
        agrees = apart < AGREED
        if agrees and pace <= STANDSTILL:
            self._off, self.disputed = (0.0, 0.0), None
            return False
        by_speed, by_turning = self._off
        by_speed += (max(-MOST, min(too_fast, MOST)) - by_speed) * share
        by_turning += (max(-MOST, min(too_turned, MOST)) - by_turning) * share
        self._off = by_speed, by_turning
        moves = pace > MOVING
        by_speed, by_turning = abs(by_speed) / self.speed.patience(moves), abs(by_turning) / self.yaw_rate.patience(moves)
        worst, turning = max(by_speed, by_turning), by_turning > by_speed
        if worst > 1.0 and not (agrees and self.disputed is not None):
            watch = self.yaw_rate if turning else self.speed
            says, measured = (yaw_rate, seen.yaw_rate) if turning else (speed, seen.speed)
            verb = "is stuck at" if watch.is_stuck else "says"
            self.disputed = f"{watch.name}: {verb} {says:.2f} {watch.unit}, the radars measure {measured:.2f} {watch.unit}"
        elif worst < AGREED:
            self.disputed = None
        return apart > 1.0

    def restart(self) -> None:
        """Forgets all that has a time."""
        self.speed.restart()
        self.yaw_rate.restart()
        self._compared_ns = None

    def lost(self, now_ns: int) -> list[str]:
        """Why the car's motion is not known; empty where it is."""
        found = [sentence for watch in (self.speed, self.yaw_rate) if (sentence := watch.silence(now_ns)) is not None]
        disputed = self.disputed
        return found or ([] if disputed is None else [disputed])

    def noted(self, now_ns: int) -> list[str]:
        """What was left out recently, though motion is known."""
        return [sentence for watch in (self.speed, self.yaw_rate) if (sentence := watch.note(now_ns)) is not None]
