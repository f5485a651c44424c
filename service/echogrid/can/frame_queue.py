"""The bounded queue between the buses and the mapping: when it is full, the oldest scans go, never ego motion."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

import can

Item = tuple[str, can.Message, float]  # bus, message, time.monotonic() when it was put


class FrameQueue:
    """Thread-safe. `dropped` counts the radar frames that were dropped.

    A full queue drops all radar frames of its older half at once: so whole scans are lost, and the others stay whole. Losing one frame at a
    time would spoil every scan. Ego motion is dropped only if it alone fills four queues, which nothing could map: `dropped_motion`.
    """

    def __init__(self, limit: int, is_motion: Callable[[str, can.Message], bool]) -> None:
        self.limit = limit
        self.is_motion = is_motion
        self.dropped = 0
        self.dropped_motion = 0
        self._items: deque[Item] = deque()
        self._filled = threading.Condition()
        self._room_at = limit  # length at which room is made

    def __len__(self) -> int:
        return len(self._items)

    def put(self, bus: str, message: can.Message) -> None:
        """Never waits."""
        with self._filled:
            if len(self._items) >= self._room_at:
                self._make_room()
            self._items.append((bus, message, time.monotonic()))
            self._filled.notify()

    def get(self, timeout: float) -> Item | None:
        """The oldest frame; None after `timeout` seconds without one."""
        with self._filled:
            if not self._items:
                self._filled.wait(timeout)
            return self._items.popleft() if self._items else None

    def _make_room(self) -> None:
        older = [self._items.popleft() for _ in range((len(self._items) + 1) // 2)]
        motion = [item for item in older if self.is_motion(item[0], item[1])]
        self.dropped += len(older) - len(motion)
        if len(self._items) + len(motion) >= 4 * self.limit:
            self.dropped_motion += len(motion)
            motion = []
        self._items.extendleft(reversed(motion))
        # Where motion has filled the queue there is nothing to gain by looking through it for every frame.
        self._room_at = max(self.limit, len(self._items) + self.limit // 2)
