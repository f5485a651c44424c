"""When the buses are looked at: not while no frame could end a cycle."""

from __future__ import annotations

import time

from echogrid.can.bus import GATHER

LONGEST = 0.05  # s: frames stay in the buffers of kernel and drivers no longer, whatever the mapping does
DRIFT = 0.0001  # s by which one look may raise what is known of the clocks


class Pace:
    """Remembers when the next look is due, and how the traffic's clock and ours lie to each other. One thread.

    Each look costs the same, however many frames it finds. So after one nothing is read until a cycle may end; then what comes is taken
    promptly. All times are s of `time.monotonic()`.
    """

    def __init__(self) -> None:
        self.rests = True  # False where frames come faster than they were recorded: their times say nothing of ours
        self._next_at = 0.0  # when the next look is due
        self._behind = float("inf")  # s: our clock's time when a frame came, less the frame's

    def rest(self) -> bool:
        """Until the next look is due, and a moment longer for what comes close behind; False where it is due already."""
        left = self._next_at - time.monotonic()
        if left <= 0 or not self.rests:
            return False
        time.sleep(left + GATHER)
        return True

    def came_at(self, stamp: float, looked_at: float) -> float:
        """When a frame of a look was there to be read, by its own time, in s."""
        if not self.rests:
            return looked_at - GATHER
        return max(min(stamp + self._behind, looked_at), looked_at - LONGEST)

    def mapped(self, newest: float, looked_at: float, expected: float) -> None:
        """All is. `newest`: time of the newest frame, in s as its own bus has it, that was read at `looked_at`; by the same clock no cycle
        is expected to end before `expected`."""
        behind = looked_at - newest
        self._behind = behind if abs(behind - self._behind) > LONGEST else min(behind, self._behind + DRIFT)
        self._next_at = min(expected + self._behind, looked_at + LONGEST - GATHER)
