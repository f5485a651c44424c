"""Which scans go into one map update: those of about a cycle's time, ended when all have come that are to come."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from echogrid.core.messages import RadarScan
from echogrid.core.radar.rhythm import Rhythm

SLACK = 10  # a cycle is longer or shorter by at most so little of itself: a tenth


class Gathering:
    """Remembers when the running cycle began and when each radar's scans come.

    It ends with the last scan of those that are due in its time, so that none waits for a frame behind it, and in any case a tenth of a
    cycle later: a radar may be lost. Where all radars come once a cycle it may end from its half on, when all have come: however their
    times jitter, no scan waits. Times are ns of receipt, by the traffic. All of them follow from the scans alone, not from which frame it
    was behind which the time was seen to be up: a recording has frames that a bus's filter keeps from the service.
    """

    def __init__(self, cycle_ns: int, max_age_ns: int) -> None:
        """A radar that is silent for longer than `max_age_ns` after its first scan is not waited for."""
        self._cycle_ns, self._slack_ns, self._max_age_ns = cycle_ns, cycle_ns // SLACK, max_age_ns
        self.restart()

    def restart(self) -> None:
        """Forgets all times: those that follow may be earlier."""
        self.begin_ns: int | None = None
        self._last: dict[str, tuple[int, int]] = {}  # by radar: the newest scan's time, and its period; 0 is not known
        self._rhythms = defaultdict[str, Rhythm](Rhythm)
        self._awaited: list[str] = []  # radars, when that was last asked
        self._newest_ns = 0  # of all scans
        self._soonest_ns = 0  # the cycle does not end before, where all radars come once a cycle
        self._earliest_ns = 0  # nor before this where they do not
        self._asked_soon = self._asked = False  # whether the one and the other have passed, and scans were due
        self._none_due = False  # whether that has passed, and none was

    def hear(self, scan: RadarScan) -> None:
        """A scan of this cycle, which begins with the first of all."""
        at_ns, last = scan.received_ns, self._last.get(scan.sensor)
        if not self._last:
            self._begin(at_ns, empty=False)
        self._last[scan.sensor] = at_ns, 0 if last is None else max(at_ns - last[0], 0) // (1 + scan.missed)
        self._rhythms[scan.sensor].hear(at_ns)
        self._newest_ns = at_ns

    def end(self, now_ns: int, *, empty: bool) -> None:
        """The next cycle begins: where time was up, a whole cycle after the last. After an `empty` one the next scan need not wait.

        Where the last scan came a little early the next begins a little earlier as well, so that scans do not go on to wait.
        """
        if self.begin_ns is None:
            return self._begin(now_ns, empty=True)
        if self._none_due or now_ns < self.latest_ns:
            return self._begin(max(self._newest_ns, min(self._earliest_ns - self._slack_ns // 2, now_ns + self._slack_ns)), empty=empty)
        rounds = (now_ns - self.begin_ns - self._slack_ns) // self._cycle_ns
        return self._begin(self.begin_ns + rounds * self._cycle_ns, empty=empty or rounds > 1)

    def _begin(self, at_ns: int, *, empty: bool) -> None:
        self.begin_ns, self._asked_soon, self._asked, self._none_due = at_ns, False, False, False
        self._earliest_ns = at_ns if empty else at_ns + self._cycle_ns - self._slack_ns
        self._soonest_ns = at_ns if empty else at_ns + self._cycle_ns // 2

    @property
    def latest_ns(self) -> int:
        """The running cycle ends then, whatever is due."""
        return (self.begin_ns or 0) + self._cycle_ns + self._slack_ns

    @property
    def ask_ns(self) -> int:
        """When time alone may end the cycle, if no scan does before."""
        return self.latest_ns if self._asked else self._earliest_ns if self._asked_soon else self._soonest_ns

    @property
    def expected_ns(self) -> int:
        """The cycle is not expected to end before, by how the radars came so far. It may, but hardly ever: nothing is decided by this."""
        if self.begin_ns is None:
            return 0
        heard = [(sensor, self._last[sensor]) for sensor in self._awaited]
        once = all(self._comes_once(period) for _, (_, period) in heard)
        due = [self._rhythms[sensor].soonest_ns for sensor, last in heard if self._is_due(*last)]
        return min(max([self._soonest_ns if once else self._earliest_ns, *due]), self.latest_ns)

    def is_whole(self, now_ns: int, awaited: Iterable[str]) -> bool:
        """Whether the cycle ends now: time is up, or none of the `awaited` radars is due before that."""
        if now_ns < self._soonest_ns or self._newest_ns < (self.begin_ns or 0):
            return now_ns >= self.latest_ns
        self._awaited = [sensor for sensor in awaited if sensor in self._last]
        heard = [self._last[sensor] for sensor in self._awaited]
        self._asked_soon, self._asked = True, now_ns >= self._earliest_ns
        if not self._asked and not all(self._comes_once(period) for _, period in heard):
            return False
        self._none_due = not any(self._is_due(*one) for one in heard)
        return self._none_due or now_ns >= self.latest_ns

    def _comes_once(self, period: int) -> bool:
        """Whether a radar is one that has a scan in each cycle, be it that some were lost."""
        times = max(round(period / self._cycle_ns), 1)
        return abs(period - times * self._cycle_ns) <= 2 * self._slack_ns

    def _is_due(self, heard_ns: int, period: int) -> bool:
        """Whether a radar's next scan is still to come in this cycle: one that would have come before the newest one is lost, and one that
        comes once a cycle and has come is due in the next, unless it is about to come with the others."""
        if not period:
            return self.latest_ns - heard_ns <= self._max_age_ns
        last_ns = self.latest_ns
        if self._comes_once(period) and heard_ns > (self.begin_ns or 0):
            last_ns = min(last_ns, self._newest_ns + self._slack_ns // 4)
        return self._newest_ns - self._slack_ns <= heard_ns + period <= last_ns
