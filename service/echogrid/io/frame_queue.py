"""The bounded queue between the buses and the mapping: when it is full, radar frames go, never ego motion."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

import can

Item = tuple[str, can.Message]  # bus, message


class FrameQueue:
    """Thread-safe. `dropped` counts the radar frames that had to go, the oldest first: their scans are then incomplete."""

    def __init__(self, limit: int, is_motion: Callable[[str, can.Message], bool]) -> None:
        self.limit = limit
        self.is_motion = is_motion
        self.dropped = 0
        self._items: deque[Item] = deque()
        self._filled = threading.Condition()

    def __len__(self) -> int:
        return len(self._items)

    def put(self, bus: str, message: can.Message) -> None:
        """Never waits."""
        with self._filled:
            if len(self._items) >= self.limit:
                self._make_room()
            self._items.append((bus, message))
            self._filled.notify()

    def get(self, timeout: float) -> Item | None:
        """The oldest frame; None after `timeout` seconds without one."""
        with self._filled:
            if not self._items:
                self._filled.wait(timeout)
            return self._items.popleft() if self._items else None

    def _make_room(self) -> None:
        oldest = next((i for i, (bus, message) in enumerate(self._items) if not self.is_motion(bus, message)), None)
        if oldest is not None:
            del self._items[oldest]
            self.dropped += 1
