"""Poses from outside over Zenoh: nav_msgs/msg/Odometry in CDR, from whoever may send them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import zenoh

from echogrid.config.tables import Pose
from echogrid.core.health import PoseHealth
from echogrid.core.messages import PoseFix
from echogrid.topics.poses import MOST_ODOMETRY, decode_pose

MOST_WAITING = 64  # messages; of more the oldest go


class PoseFeed:
    """Remembers the messages that wait. Zenoh's thread puts them, one other takes; none waits."""

    def __init__(self, session: zenoh.Session, pose: Pose, counts: PoseHealth) -> None:
        """`counts` is added to by who takes."""
        self._latency_ns = round(pose.latency_ms * 1e6)
        self._counts = counts
        self._waiting: deque[bytes] = deque(maxlen=MOST_WAITING)
        # Called in Zenoh's own thread: with a thread between them, a program that ends without closing would never end.
        self._subscriber = session.declare_subscriber(str(pose.key), zenoh.handlers.Callback(self._hear, indirect=False))

    def take(self) -> Iterator[PoseFix]:
        """Those that have come since; one that cannot be read is counted."""
        while self._waiting:
            try:
                stamp_ns, pose = decode_pose(self._waiting.popleft())
            except ValueError:
                self._counts.invalid += 1
                continue
            stamp_ns -= self._latency_ns
            yield PoseFix(stamp_ns, pose.x, pose.y, stamp_ns, pose.yaw)

    def _hear(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            payload = sample.payload
            self._waiting.append(bytes(payload) if len(payload) <= MOST_ODOMETRY else b"")
