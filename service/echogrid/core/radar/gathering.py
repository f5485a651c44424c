"""Which scans go into one map update: those of about a cycle's time, ended when all have come that are to come."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from echogrid.core.messages import RadarScan
from echogrid.core.radar.rhythm import Rhythm

SLACK = 10  # a cycle is longer or shorter by at most so little of itself: a tenth
Heard = tuple[int, int, bool]  # a radar's newest scan's time; its period, 0 is not known; whether that is once a cycle


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
        self.latest_ns = 0  # the running cycle ends then, whatever is due
        self.ask_ns = 0  # when time alone may end the cycle, if no scan does before
        self.settled_ns = 0  # until then it surely goes on: it was asked, and no scan came since
        self._last: dict[str, Heard] = {}  # by radar
        self._rhythms = defaultdict[str, Rhythm](Rhythm)
        self._awaited: list[str] = []  # radars, when that was last asked
        self._newest_ns = 0  # of all scans
        self._soonest_ns = 0  # the cycle does not end before, where all radars come once a cycle
        self._earliest_ns = 0  # nor before this where they do not
        self._none_due = False  # whether that has passed, and no scan was due

    def hear(self, scan: RadarScan) -> None:
        """A scan of this cycle, which begins with the first of all."""
        at_ns, sensor, last, period = scan.received_ns, scan.sensor, self._last, 0
        if not last:
            self._begin(at_ns, empty=False)
        elif sensor in last and (step_ns := at_ns - last[sensor][0]) > 0:
            period = step_ns // (1 + scan.missed)
        last[sensor] = at_ns, period, self._comes_once(period)
        self._rhythms[sensor].hear(at_ns)
        self._newest_ns, self.settled_ns = at_ns, self._soonest_ns

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
        self.begin_ns, self.latest_ns, self._none_due = at_ns, at_ns + self._cycle_ns + self._slack_ns, False
        self._earliest_ns = at_ns if empty else at_ns + self._cycle_ns - self._slack_ns
        self.ask_ns = self.settled_ns = self._soonest_ns = at_ns if empty else at_ns + self._cycle_ns // 2

    @property
    def expected_ns(self) -> int:
        """The cycle is not expected to end before, by how the radars came so far. It may, but hardly ever: nothing is decided by this."""
        if self.begin_ns is None:
            return 0
        once = all(self._last[sensor][2] for sensor in self._awaited)
        due = [self._rhythms[sensor].soonest_ns for sensor in self._due()]
        return min(max([self._soonest_ns if once else self._earliest_ns, *due]), self.latest_ns)

    def is_whole(self, now_ns: int, awaited: Iterable[str]) -> bool:
        """Whether the cycle ends now: time is up, or none of the `awaited` radars is due before that. Which are awaited may change with a
        scan, and with the end of a cycle; else the answer is the same until `settled_ns`."""
        if now_ns < self._soonest_ns or self._newest_ns < (self.begin_ns or 0):
            return now_ns >= self.latest_ns
        last, asked = self._last, now_ns >= self._earliest_ns
        self._awaited = [sensor for sensor in awaited if sensor in last]
        self.ask_ns = self.settled_ns = self.latest_ns if asked else self._earliest_ns
        if not asked and False in [last[sensor][2] for sensor in self._awaited]:
            return False
        self._none_due = not self._due()
        return self._none_due or now_ns >= self.latest_ns

    def _comes_once(self, period: int) -> bool:
        """Whether a radar is one that has a scan in each cycle, be it that some were lost."""
        longer_ns = period + 2 * self._slack_ns
        return longer_ns >= self._cycle_ns and longer_ns % self._cycle_ns <= 4 * self._slack_ns

    def _due(self) -> list[str]:
        """The awaited radars whose next scan is still to come in this cycle: one that would have come before the newest one is lost, and
        one that comes once a cycle and has come is due in the next, unless it is about to come with the others."""
        begin_ns, first_ns, last_ns, found = self.begin_ns or 0, self._newest_ns - self._slack_ns, self.latest_ns, list[str]()
        with_others_ns = min(last_ns, self._newest_ns + self._slack_ns // 4)
        for sensor in self._awaited:
            heard_ns, period, once = self._last[sensor]
            if not period:
                is_due = last_ns - heard_ns <= self._max_age_ns
            else:
                is_due = first_ns <= heard_ns + period <= (with_others_ns if once and heard_ns > begin_ns else last_ns)
            if is_due:
                found.append(sensor)
        return found
