"""The bounded queue between the buses and the mapping: when it is full, the oldest scans go, never ego motion."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import FrameBatch

Item = tuple[str, FrameBatch, float]  # bus, frames, s of time.monotonic() when they were read


class FrameQueue:
    """One thread at a time puts or takes; its length is in frames. `dropped` counts the radar frames that were dropped.

    A full queue drops all radar frames of its older half at once: so whole scans are lost, and the others stay whole. Losing one frame at a
    time would spoil every scan. Ego motion is dropped only if it alone fills four queues, which nothing could map: `dropped_motion`.
    """

    def __init__(self, limit: int, is_motion: Callable[[str, FrameBatch], NDArray[np.bool_]]) -> None:
        """`is_motion`: which frames (N,) of a bus are."""
        self.limit = limit
        self.is_motion = is_motion
        self.dropped = 0
        self.dropped_motion = 0
        self._items: deque[Item] = deque()
        self._frames = 0
        self._room_at = limit  # length at which room is made

    def __len__(self) -> int:
        return self._frames

    def put(self, bus: str, batch: FrameBatch, read_at: float) -> None:
        """Never waits."""
        if self._frames >= self._room_at:
            self._make_room()
        self._items.append((bus, batch, read_at))
        self._frames += len(batch)

    def take(self, most: int) -> list[Item]:
        """The oldest frames, up to the first `most` or more of them; never waits."""
        items, count = list[Item](), 0
        while self._items and count < most:
            items.append(self._items.popleft())
            count += len(items[-1][1])
        self._frames -= count
        return items

    def _make_room(self) -> None:
        older, half, count = list[Item](), (self._frames + 1) // 2, 0
        while count < half:
            older.append(self._items.popleft())
            count += len(older[-1][1])
        motion = [(bus, batch.where(self.is_motion(bus, batch)), read_at) for bus, batch, read_at in older]
        kept = sum(len(batch) for _, batch, _ in motion)
        self._frames -= count
        self.dropped += count - kept
        if self._frames + kept >= 4 * self.limit:
            self.dropped_motion += kept
            motion, kept = [], 0
        self._items.extendleft(item for item in reversed(motion) if len(item[1]))
        self._frames += kept
        # Where motion has filled the queue there is nothing to gain by looking through it for every frame.
        self._room_at = max(self.limit, self._frames + self.limit // 2)
