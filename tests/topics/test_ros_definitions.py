"""What recordings say of ROS's messages is what ROS says: fields, constants and type hashes of independent code."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from echogrid.topics.ros_definitions import _FIELDS, CAN_FRAME, definition
from echogrid.topics.topic import TOPICS

THEIRS = get_typestore(Stores.ROS2_JAZZY)
UPDATE_HASH = "RIHS01_c4095b0be2e4363f8978a1570e0293ee093436f1e1c61d99b48502ac317025e8"  # of a map_msgs/OccupancyGridUpdate of RViz's


@pytest.mark.parametrize("name", sorted(_FIELDS))
def test_every_definition_is_ros_own(name: str) -> None:
    kind = name.replace("/", "/msg/")
    ours = get_typestore(Stores.EMPTY)
    ours.register(get_types_from_msg(definition(kind), kind))
    if kind == "map_msgs/msg/OccupancyGridUpdate":
        assert ours.hash_rihs01(kind) == UPDATE_HASH
    elif kind != CAN_FRAME:
        assert ours.fielddefs[kind] == THEIRS.fielddefs[kind]
        assert ours.hash_rihs01(kind) == THEIRS.hash_rihs01(kind)


def test_every_topic_has_one() -> None:
    assert all(definition(topic.type) for topic in TOPICS if topic.type is not None)
