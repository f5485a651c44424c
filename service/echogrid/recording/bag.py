"""What makes an MCAP file a ROS 2 bag: the quality of service that a player offers, and rosbag2's description of a bag."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from echogrid.zenoh.ros import HASHES

# Until version 8, policies are numbers, which Humble knows alone; what is newer reads them in a bag that says so.
VERSION = 8
DISTRO = "jazzy"
KEEP_LAST, RELIABLE, AUTOMATIC = 1, 1, 1
TRANSIENT_LOCAL, VOLATILE = 1, 2
NEVER = {"sec": 9223372036, "nsec": 854775807}  # rmw's infinite duration


@dataclass(slots=True)
class BagTopic:
    """A topic of a bag, whose messages are all in CDR."""

    type: str
    quality: str
    messages: int = 0


def quality(depth: int, kept: bool) -> str:
    """`offered_qos_profiles` of a publisher: reliable, keep last; `kept`: the last messages reach whoever comes later."""
    profile = {
        "history": KEEP_LAST,
        "depth": depth,
        "reliability": RELIABLE,
        "durability": TRANSIENT_LOCAL if kept else VOLATILE,
        "deadline": dict(NEVER),
        "lifespan": dict(NEVER),
        "liveliness": AUTOMATIC,
        "liveliness_lease_duration": dict(NEVER),
        "avoid_ros_namespace_conventions": False,
    }
    return _as_yaml([profile]).strip()


def information(file: str | None, topics: Mapping[str, BagTopic], first_ns: int, last_ns: int) -> dict[str, Any]:
    """rosbag2's description of a bag of one MCAP file, whose messages lie between the two times. In the file itself it names none."""
    count = sum(topic.messages for topic in topics.values())
    span = {"duration": {"nanoseconds": last_ns - first_ns}, "starting_time": {"nanoseconds_since_epoch": first_ns}, "message_count": count}
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": [_counted(name, topic) for name, topic in topics.items()],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [] if file is None else [file],
        "files": [] if file is None else [{"path": file, **span}],
        "custom_data": None,
        "ros_distro": DISTRO,
    }


def serialized(described: Mapping[str, Any]) -> str:
    """As yaml."""
    return _as_yaml(dict(described))


def _as_yaml(value: object) -> str:
    import yaml  # a service that records nothing need not load it

    return str(yaml.safe_dump(value, sort_keys=False))


def _counted(name: str, topic: BagTopic) -> dict[str, Any]:
    digest = HASHES.get(topic.type)
    return {
        "topic_metadata": {
            "name": name,
            "type": topic.type,
            "serialization_format": "cdr",
            "offered_qos_profiles": topic.quality,
            "type_description_hash": "" if digest is None else f"RIHS01_{digest}",
        },
        "message_count": topic.messages,
    }
