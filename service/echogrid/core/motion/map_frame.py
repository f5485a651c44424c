"""Where odom lies in a frame that does not drift, by poses from outside: another odometry, or satellites."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import asdict, dataclass

from echogrid.core.health import PoseHealth
from echogrid.core.messages import PoseFix
from echogrid.core.motion.odometry import Odometry
from echogrid.core.motion.se2 import SE2

NS = 1e-9
STATES = ("ok", "waiting", "jumping", "silent")
MOST_WAITING = 256  # poses that dead reckoning has not come to yet
AHEAD_NS = 1_000_000_000  # a pose that is newer than the car's own motion by more is of another clock
SILENT_NS = 1_000_000_000
BELIEVED_NS = 1_000_000_000  # poses that lie elsewhere, but go with dead reckoning from there on, for so long are believed
WAY, STOOD = 5.0, 0.5  # m over which poses have to go with dead reckoning; a car that drives less stands, and need not go so far
STEP = 0.5  # m between two poses that are kept
FAR, FAR_PER_M = 2.0, 0.05  # m, and m per metre driven between two poses: dead reckoning drifts by no more
TURNED, TURNED_PER_S = math.radians(5.0), math.radians(1.0)  # rad, and rad/s


@dataclass(frozen=True, slots=True)
class _Told:
    """What one pose says."""

    stamp_ns: int
    driven: float  # m, by the car until then
    seconds: float  # in which it drove: while it stands, dead reckoning does not drift
    map_from_odom: SE2


class MapFrame:
    """Remembers the poses of the last metres that were believed, and those that were not.

    Every pose places odom anew: map_from_base @ inverse(odom_from_base), both at the pose's own time. Nothing is smoothed, and nothing in
    odom moves. A pose waits until dead reckoning has come to its time.
    """

    def __init__(self, base_from_point: SE2, counts: PoseHealth) -> None:
        """`base_from_point`: the point that the poses are of. `counts` is added to."""
        self.base_from_point = base_from_point
        self.counts = counts
        self.restart()

    def restart(self) -> None:
        """Another map: odom begins somewhere else."""
        self._waiting: deque[PoseFix] = deque(maxlen=MOST_WAITING)
        self._newest_ns: int | None = None  # of those that could be placed
        self._last: _Told | None = None
        self._way: deque[_Told] = deque()  # of those believed before, one in STEP: the first is the newest that is WAY behind, if one is
        self._other: _Told | None = None  # the newest that was not believed
        self._others: _Told | None = None  # the first of those that go together with it
        self._off = 0.0  # m by which it is off
        self._clock = ""  # what is wrong with the times of poses
        self._before = asdict(self.counts)  # when the last one was believed

    @property
    def map_from_odom(self) -> SE2 | None:
        """None before the first pose in a map. Yaw within [-pi, pi]."""
        last = self._last  # read once: another thread may be asking while `restart` takes it away
        return None if last is None else last.map_from_odom

    def add(self, fix: PoseFix) -> None:
        """A pose, in whatever order."""
        self._waiting.append(fix)

    def settle(self, odometry: Odometry) -> None:
        """Takes the poses whose time dead reckoning has come to."""
        while self._waiting and odometry.states:
            fix = self._waiting[0]
            ahead_ns = max(fix.stamp_ns, fix.yaw_ns) - odometry.states[-1].stamp_ns
            if 0 < ahead_ns <= AHEAD_NS:
                return
            self._waiting.popleft()
            if ahead_ns > 0:
                self._miss(f"its times are {ahead_ns * NS:.1f} s ahead of the car's")
            elif self._newest_ns is not None and fix.stamp_ns <= self._newest_ns:
                self.counts.old += 1
            else:
                self._place(fix, odometry)

    def state(self, now_ns: int) -> tuple[str, str]:
        """`ok`, `waiting` for the first pose, `jumping` or `silent`; and why, where it is not ok."""
        last, other = self._last, self._other
        if last is None:
            return "waiting", f"none in this map so far{self._why()}"
        if other is not None and now_ns - other.stamp_ns <= SILENT_NS:
            return "jumping", f"{self._off:.1f} m off dead reckoning"
        age_ns = now_ns - last.stamp_ns
        return ("silent", f"none for {age_ns * NS:.1f} s{self._why()}") if age_ns > SILENT_NS else ("ok", "")

    def _why(self) -> str:
        """What has come since the last one, but was not taken."""
        more = {name: count - self._before[name] for name, count in asdict(self.counts).items() if name in ("invalid", "old")}
        counted = ", ".join(f"{count} {name}" for name, count in more.items() if count)
        return (f": {self._clock}" if self._clock else "") + (f" ({counted})" if counted else "")

    def _miss(self, why: str) -> None:
        self.counts.untimely += 1
        self._clock = why

    def _place(self, fix: PoseFix, odometry: Odometry) -> None:
        ego, turned = odometry.at(fix.stamp_ns), odometry.at(fix.yaw_ns)
        if ego is None or turned is None:
            self._miss(f"its times are {(odometry.states[-1].stamp_ns - min(fix.stamp_ns, fix.yaw_ns)) * NS:.1f} s behind the car's")
            return
        self._newest_ns = fix.stamp_ns
        point = ego.odom_from_base @ self.base_from_point
        yaw = math.remainder(fix.yaw - self.base_from_point.yaw - turned.odom_from_base.yaw, math.tau)
        turn = SE2(0.0, 0.0, yaw) @ point
        before, driven = self._other or self._last, odometry.distance
        seconds = 0.0 if before is None else before.seconds + (fix.stamp_ns - before.stamp_ns) * NS * (driven > before.driven)
        told = _Told(fix.stamp_ns, driven, seconds, SE2(fix.x - turn.x, fix.y - turn.y, yaw))
        if self._last is None or _agree(self._way[0], told, point):
            self._believe(told)
            return
        if self._others is None or not _agree(self._others, told, point):
            self._others = told
        self._other, self._off = told, _apart(self._last, told, point)
        way = told.driven - self._others.driven
        if told.stamp_ns - self._others.stamp_ns >= BELIEVED_NS and not STOOD < way < WAY:
            self.counts.moved += 1
            self._way.clear()
            self._believe(told)
        else:
            self.counts.jumped += 1

    def _believe(self, told: _Told) -> None:
        self.counts.taken += 1
        self._last, self._other, self._others, self._clock = told, None, None, ""
        self._before = asdict(self.counts)
        if not self._way or told.driven - self._way[-1].driven >= STEP:
            self._way.append(told)
        while len(self._way) > 1 and told.driven - self._way[1].driven >= WAY:
            self._way.popleft()


def _apart(one: _Told, other: _Told, point: SE2) -> float:
    """m between where two poses place a point of odom in the map frame."""
    first, second = one.map_from_odom @ point, other.map_from_odom @ point
    return math.hypot(second.x - first.x, second.y - first.y)


def _agree(before: _Told, after: _Told, point: SE2) -> bool:
    """Whether dead reckoning may have drifted by so much from one pose to the other."""
    turned = abs(math.remainder(after.map_from_odom.yaw - before.map_from_odom.yaw, math.tau))
    seconds, metres = after.seconds - before.seconds, after.driven - before.driven
    far = FAR + metres * (FAR_PER_M + TURNED_PER_S * seconds / 2)  # what turns by so much arrives so far beside
    return turned <= TURNED + TURNED_PER_S * seconds and _apart(before, after, point) <= far
