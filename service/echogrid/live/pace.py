"""When the buses are looked at: all at once, and not while no frame could end a cycle."""

from __future__ import annotations

import threading
import time

from echogrid.can.bus import GATHER

LONGEST = 0.05  # s: frames stay in the buffers of kernel and drivers no longer, whatever the mapping does
BUSY = 0.003  # s from a look to the next where the mapping has not said anything meanwhile
DRIFT = 0.0001  # s by which one look may raise what is known of the clocks


class Pace:
    """Remembers when the next look is due, who waits for it, and how the traffic's clock and ours lie to each other.

    Each look costs the same, however many frames it finds. So after one the threads that receive rest, until the mapping has worked and
    said when a cycle may end. Then what comes is taken promptly, GATHER after the first frame. All times are s of `time.monotonic()`.
    """

    def __init__(self) -> None:
        self.rests = True  # False where frames come faster than they were recorded: their times say nothing of ours
        lock = threading.Lock()
        self._due, self._over = threading.Condition(lock), threading.Condition(lock)
        self._next_at = 0.0
        self._waiting: set[str] = set()  # buses that have frames for the next look
        self._looking: set[str] = set()  # and those that are read now
        self._behind = float("inf")  # s: our clock's time when a frame came, less the frame's

    def wait(self, bus: str) -> None:
        """For the next look, which the first bus begins that has waited long enough; called when a frame has come."""
        with self._due:
            self._waiting.add(bus)
            came_at = time.monotonic()
            while bus in self._waiting:
                now = time.monotonic()
                left = max(self._next_at, came_at + GATHER) - now
                if left > 0:
                    self._due.wait(left)
                    continue
                self._looking |= self._waiting
                self._waiting.clear()
                if self.rests:
                    self._next_at = now + BUSY
                self._due.notify_all()

    def looked(self, bus: str, *, again: bool) -> None:
        """A bus was read. `again`: without delay, since there was nothing to map, or more than was read."""
        with self._due:
            if again and bus in self._looking:
                self._next_at = 0.0
            self._looking.discard(bus)
            if not self._looking:
                self._over.notify_all()

    def settle(self) -> None:
        """Waits until all buses of a look are read."""
        with self._over:
            self._over.wait_for(lambda: not self._looking, timeout=GATHER)

    def came_at(self, stamp: float, looked_at: float) -> float:
        """When a frame of a look was there to be read, by its own time, in s."""
        if not self.rests:
            return looked_at - GATHER
        return max(min(stamp + self._behind, looked_at), looked_at - LONGEST)

    def resume(self, newest: float, looked_at: float, expected: float) -> None:
        """All is mapped. `newest`: time of the newest frame, in s as its own bus has it, that was read at `looked_at`; by the same clock
        no cycle is expected to end before `expected`."""
        behind = looked_at - newest
        with self._due:
            self._behind = behind if abs(behind - self._behind) > LONGEST else min(behind, self._behind + DRIFT)
            if self.rests:
                self._next_at = min(expected + self._behind, looked_at + LONGEST)
                self._due.notify_all()
