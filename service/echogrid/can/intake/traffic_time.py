"""The time of the traffic, which strays do not move: that of its newest frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STEP_NS = 1_000_000_000  # a frame that is older or newer than the newest by more was not reordered: it is a stray, or time has stepped
BACK_FOR_NS = 1_000_000_000  # if frames stay older than the newest one for so long, the clock was set back
AHEAD_FOR = 5  # frames in a row so far after it: there was a pause, or the clock was set forward
NEVER = -(2**63)  # ns, of the newest frame before there is one


class TrafficTime:
    """Remembers the newest frame's time, and a run of frames that disagree with it. One stray frame moves nothing."""

    def __init__(self) -> None:
        self.newest_ns: int | None = None
        self.set_back = 0  # how many times
        self._run_ns: tuple[int, int] | None = None  # first and newest of the frames that disagree
        self._run = 0

    def takes(self, received_ns: int) -> bool:
        """Whether a frame's time can be trusted."""
        newest_ns = self.newest_ns
        if newest_ns is None or -STEP_NS <= received_ns - newest_ns <= STEP_NS:
            if newest_ns is None or received_ns > newest_ns:
                self.newest_ns = received_ns
            self._run_ns = None
            return True
        if self._run_ns is None or abs(received_ns - self._run_ns[1]) > STEP_NS:
            self._run_ns, self._run = (received_ns, received_ns), 0
        self._run_ns = self._run_ns[0], max(received_ns, self._run_ns[1])
        self._run += 1
        back = received_ns < newest_ns
        if self.waiting_ns < BACK_FOR_NS if back else self._run < AHEAD_FOR:
            return False
        self.set_back += back
        self.newest_ns, self._run_ns = received_ns, None
        return True

    @property
    def waiting_ns(self) -> int:
        """For how long frames have come that disagree."""
        return 0 if self._run_ns is None else self._run_ns[1] - self._run_ns[0]

    def newest_after(self, received_ns: NDArray[np.int64], counts: NDArray[np.bool_]) -> NDArray[np.int64] | None:
        """The newest time after each of the frames (N,) if all that count are taken, NEVER before the first; None if one may not be.

        Changes nothing.
        """
        before = NEVER if self.newest_ns is None else self.newest_ns
        newest = np.maximum.accumulate(np.where(counts, received_ns, NEVER))
        np.maximum(newest, before, out=newest)
        last = np.concatenate(([before], newest[:-1]))
        away = np.abs(received_ns - last)[counts & (last != NEVER)]
        return newest if not len(away) or away.max() <= STEP_NS else None

    def advance(self, newest_ns: int) -> None:
        """To a time that `newest_after` gave, of frames that count."""
        self.newest_ns, self._run_ns = newest_ns, None


def nanoseconds(stamps: NDArray[np.float64]) -> NDArray[np.int64]:
    """Seconds (N,) as ns, to the microsecond.

    A float of seconds since 1970 holds microseconds, not nanoseconds. Of its fraction, 22 bits, the product is exact, so that it is rounded
    as in a text log; rounding the whole float would give another microsecond for one frame in eight.
    """
    fraction, seconds = np.modf(stamps)
    found: NDArray[np.int64] = (seconds.astype(np.int64) * 1_000_000 + np.rint(fraction * 1e6).astype(np.int64)) * 1000
    return found
