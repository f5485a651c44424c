"""When a radar's next scan is expected, by those before it."""

from __future__ import annotations

PULL = 5  # a fifth of what a scan is off by moves those to come
FADE = 100  # of how early scans came, a hundredth is forgotten with each
UNSURE = 8  # a radar's second scan may be early by an eighth of its period


class Rhythm:
    """Remembers a radar's scans as times that are evenly apart, their jitter smoothed, and how early the earliest came. Times are ns."""

    def __init__(self) -> None:
        self._at_ns: int | None = None  # of the newest scan, without its jitter
        self._period_ns = 0  # 0 is not known
        self._early_ns = 0

    def hear(self, at_ns: int) -> None:
        """A scan; some before it may be lost. One that is off by more than a quarter of the period begins anew."""
        if self._at_ns is None:
            self._at_ns = at_ns
            return
        step_ns, period_ns = at_ns - self._at_ns, self._period_ns
        times = max(round(step_ns / period_ns), 1) if period_ns else 0
        off_ns = step_ns - times * period_ns
        if not period_ns or abs(off_ns) > period_ns // 4:
            self._at_ns, self._period_ns = at_ns, max(step_ns, 0)
            self._early_ns = self._period_ns // UNSURE
            return
        self._at_ns = at_ns - off_ns + off_ns // PULL
        self._period_ns += off_ns // (4 * PULL * PULL)
        self._early_ns = max(self._early_ns - self._early_ns // FADE, -off_ns)

    @property
    def soonest_ns(self) -> int:
        """The next scan is expected then or later; 0 is not known."""
        if self._at_ns is None or not self._period_ns:
            return 0
        return self._at_ns + self._period_ns - self._early_ns
