"""The time of the traffic, which strays do not move: that of its newest frame."""

from __future__ import annotations

from echogrid.core.kernels.scans import STEP_NS

BACK_FOR_NS = 1_000_000_000  # if frames stay older than the newest one for so long, the clock was set back
AHEAD_FOR = 5  # frames in a row so far after it: there was a pause, or the clock was set forward


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
        run_ns = self._run_ns  # read once: another thread may be asking
        return 0 if run_ns is None else run_ns[1] - run_ns[0]

    def advance(self, newest_ns: int) -> None:
        """To the time of the newest of frames none of which was off by more than a step."""
        self.newest_ns, self._run_ns = newest_ns, None
