"""What a recording or a viewer has to know about a topic to understand its bytes: MCAP's and Foxglove's channels."""

from __future__ import annotations

import json
from dataclasses import dataclass

from echogrid.topics.ros_definitions import CAN_FRAME, definition
from echogrid.topics.topic import META, NAMESPACE, STATUS, Topic

TEXT = "std_msgs/msg/String"
_TEXT, _NUMBER, _OBJECT = {"type": "string"}, {"type": "number"}, {"type": "object"}
# Of JSON topics what a viewer may plot or list by name; there is more in them.
_JSON = {
    STATUS.name: {
        "state": _TEXT,
        "reasons": {"type": "array", "items": _TEXT},
        "epoch": _NUMBER,
        "model": _TEXT,
        "frames": _NUMBER,
        "bad_frames": _NUMBER,
        "lost_frames": _NUMBER,
        "cycles": _NUMBER,
        "detections": _NUMBER,
        "static_detections": _NUMBER,
        "sensors": _OBJECT,
        "buses": _OBJECT,
    },
    META.name: {"vehicle": _TEXT, "version": _TEXT, "model": _TEXT, "frames": _OBJECT, "grid": _OBJECT, "body": _OBJECT, "keys": _OBJECT},
}


@dataclass(frozen=True, slots=True)
class ViewerChannel:
    """Names and definitions as the registry of MCAP has them."""

    topic: str
    message_encoding: str  # "cdr" or "json"
    schema: str  # its name
    schema_encoding: str  # "ros2msg" or "jsonschema"
    definition: bytes


def viewer_channel(topic: Topic) -> ViewerChannel:
    """By its name under ROS where it has one."""
    name = topic.ros or f"{NAMESPACE}/{topic.name}"
    if topic.type is not None:
        return ViewerChannel(name, "cdr", topic.type, "ros2msg", definition(topic.type).encode())
    schema = {"title": f"echogrid {topic.name}", "type": "object", "properties": _JSON[topic.name]}
    return ViewerChannel(name, "json", f"echogrid.{topic.name}", "jsonschema", json.dumps(schema).encode())


def recorded_channel(topic: Topic) -> ViewerChannel:
    """As in a recording, which is a ROS 2 bag: what is JSON is the text of a message of ROS there."""
    told = viewer_channel(topic)
    return told if topic.type is not None else ViewerChannel(told.topic, "cdr", TEXT, "ros2msg", definition(TEXT).encode())


def can_channel(bus: str) -> ViewerChannel:
    """The frames of a bus."""
    return ViewerChannel(f"/can/{bus}", "cdr", CAN_FRAME, "ros2msg", definition(CAN_FRAME).encode())
