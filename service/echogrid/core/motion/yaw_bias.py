"""The yaw-rate sensor's bias, learned while the car stands still."""

from __future__ import annotations

from collections import deque

SETTLING_NS = 1_000_000_000  # after wheels read 0 and before they do not: many sensors read 0 below a walking pace
MOST = 2000  # samples that the mean remembers: 20 s at 100 Hz
PLAUSIBLE = 0.05  # rad/s: more is not a bias


class YawBias:
    """Remembers the mean yaw rate of the time in which the car surely stood: not the first second of a stop, and not its last."""

    def __init__(self) -> None:
        self.bias = 0.0  # rad/s
        self._samples = 0
        self._standing_since_ns: int | None = None
        self._pending: deque[tuple[int, float]] = deque()  # stamps and rates that a standstill of one more second will confirm

    def add(self, stamp_ns: int, yaw_rate: float, *, standing: bool) -> None:
        """One sample of the sensor, and whether the wheels stand."""
        if not standing or abs(yaw_rate) > PLAUSIBLE:
            self.restart()
            return
        if self._standing_since_ns is None:
            self._standing_since_ns = stamp_ns
        if stamp_ns - self._standing_since_ns >= SETTLING_NS:
            self._pending.append((stamp_ns, yaw_rate))
        while self._pending and stamp_ns - self._pending[0][0] >= SETTLING_NS:
            self._samples = min(self._samples + 1, MOST)
            self.bias += (self._pending.popleft()[1] - self.bias) / self._samples

    def restart(self) -> None:
        """The samples that follow do not continue those before; the bias stays."""
        self._standing_since_ns = None
        self._pending.clear()
