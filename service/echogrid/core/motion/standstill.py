"""What the yaw-rate sensor shows while the car surely stands: its bias."""

from __future__ import annotations

from collections import deque

NS = 1e-9
SETTLING_NS = 1_000_000_000  # after wheels read 0 and before they do not: many sensors read 0 below a walking pace
BATCH_NS = 500_000_000  # over which readings are averaged
PLAUSIBLE = 0.05  # rad/s: more is not a bias


class Standstill:
    """Remembers the readings of a stop until it has gone on for one more second: neither the first second of a stop counts nor its last."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._pending: deque[tuple[int, float]] = deque()  # stamps and rates that one more second will confirm

    def add(self, stamp_ns: int, yaw_rate: float, *, standing: bool) -> tuple[float, float] | None:
        """One reading, and whether the wheels stand. Where another batch is confirmed: how long it took (s), and its mean (rad/s)."""
        if not standing or abs(yaw_rate) > PLAUSIBLE:
            if self._since_ns is not None:
                self.restart()
            return None
        if self._since_ns is None:
            self._since_ns = stamp_ns
        if stamp_ns - self._since_ns >= SETTLING_NS:
            self._pending.append((stamp_ns, yaw_rate))
        if not self._pending or stamp_ns - self._pending[0][0] < SETTLING_NS + BATCH_NS:
            return None
        first_ns, rates = self._pending[0][0], []
        while stamp_ns - self._pending[0][0] >= SETTLING_NS:
            newest_ns, rate = self._pending.popleft()
            rates.append(rate)
        return (newest_ns - first_ns) * NS, sum(rates) / len(rates)

    def restart(self) -> None:
        """The readings that follow do not continue those before."""
        self._since_ns = None
        self._pending.clear()
