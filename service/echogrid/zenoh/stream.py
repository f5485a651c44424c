"""One topic under one Zenoh key."""

from __future__ import annotations

from typing import Any

import zenoh
import zenoh.ext

from echogrid.topics.topic import Message, Topic
from echogrid.zenoh.attachment import encode_attachment, encode_version

PRIORITIES = (zenoh.Priority.DATA_HIGH, zenoh.Priority.DATA, zenoh.Priority.DATA_LOW, zenoh.Priority.BACKGROUND)  # by rank
PACKED = zenoh.Encoding("application/cdr+zstd")


class Stream:
    """Remembers how many samples it sent. No put waits for a subscriber: one that is too slow misses samples."""

    def __init__(self, session: zenoh.Session, key: str, topic: Topic, gid: bytes, *, versioned: bool) -> None:
        """`gid`: 16 bytes that name the publisher. `versioned`: which map and key frame follows rmw_zenoh's attachment."""
        self.gid = gid
        self.versioned = versioned
        self.sequence = 0
        settings: dict[str, Any] = {
            "encoding": encoding(topic),
            # DROP loses large messages whenever a fragment waits, BLOCK stops us for seconds behind one frozen subscriber.
            "congestion_control": zenoh.CongestionControl.BLOCK_FIRST if topic.rank else zenoh.CongestionControl.DROP,
            "priority": PRIORITIES[topic.rank],  # each has a queue of its own: of two grids in one, the second is lost if the first waits
            "reliability": zenoh.Reliability.RELIABLE,
        }
        self.publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher
        if topic.kept:
            self.publisher = zenoh.ext.declare_advanced_publisher(
                session,
                key,
                **settings,
                # A cache of one and `publisher_detection` bring the last message to late subscribers, also to ROS nodes.
                cache=zenoh.ext.CacheConfig(1),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
                publisher_detection=True,
            )
            self._asked = session.declare_publisher(key)  # sends nothing: an advanced one does not tell whether it has subscribers
        else:
            self.publisher = self._asked = session.declare_publisher(key, **settings)

    def put(self, message: Message) -> None:
        self.sequence += 1
        attachment = encode_attachment(self.sequence, message.stamp_ns, self.gid)
        if self.versioned:
            attachment += encode_version(message.epoch, message.keyframe)
        self.publisher.put(message.payload, attachment=attachment)

    def heard(self) -> bool:
        """Whether there are subscribers."""
        return is_heard(self._asked)


def is_heard(publisher: zenoh.Publisher) -> bool:
    """Whether there are subscribers."""
    status: Any = publisher.matching_status  # which zenoh's types call a bool
    return bool(status.matching)


def encoding(topic: Topic) -> zenoh.Encoding:
    """Zenoh's name for what a topic's payloads are."""
    if topic.type is None:
        return zenoh.Encoding.APPLICATION_JSON
    return (PACKED if topic.packed else zenoh.Encoding.APPLICATION_CDR).with_schema(topic.type)
