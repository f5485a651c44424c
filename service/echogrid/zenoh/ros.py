"""The topics as a ROS 2 node publishes them through rmw_zenoh: its keys, liveliness tokens and attachments. No bridge, no ROS.

After rmw_zenoh's design document, https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md
"""

from __future__ import annotations

from collections.abc import Iterator

import xxhash
import zenoh

from echogrid.config.tables import Ros
from echogrid.topics.topic import TOPICS, Topic
from echogrid.zenoh.stream import Stream

NODE = "echogrid"
NODE_ID = 0  # the publishers count on from it
DEFAULT_DEPTH = 42  # rmw_zenoh's own, which it leaves out

# REP-2011's hashes of the types' definitions, the same in all distributions since Iron.
HASHES = {
    "nav_msgs/msg/OccupancyGrid": "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7",
    "map_msgs/msg/OccupancyGridUpdate": "c4095b0be2e4363f8978a1570e0293ee093436f1e1c61d99b48502ac317025e8",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "tf2_msgs/msg/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "sensor_msgs/msg/PointCloud2": "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}


class RosNode:
    """Remembers the tokens that make it visible and a stream for each topic that ROS knows; with `distro` "off" none."""

    def __init__(self, session: zenoh.Session, settings: Ros) -> None:
        self.streams: dict[Topic, Stream] = {}
        self.tokens: list[zenoh.LivelinessToken] = []
        if settings.distro == "off":
            return
        liveliness, zid = session.liveliness(), str(session.zid())
        self.tokens.append(liveliness.declare_token(node_token(settings, zid)))
        for number, (topic, key) in enumerate(topic_keys(settings), NODE_ID + 1):
            token = publisher_token(settings, zid, number, topic)
            self.streams[topic] = Stream(session, key, topic, gid(token), versioned=False)
            self.tokens.append(liveliness.declare_token(token))


def topic_keys(settings: Ros) -> Iterator[tuple[Topic, str]]:
    """The topics that ROS knows, each with its key."""
    for topic in TOPICS:
        name = topic.ros_name(settings.namespace)
        if name is not None:
            yield topic, f"{settings.domain}/{name.strip('/')}/{_type(settings, topic)}"


def viewed(settings: Ros) -> list[str]:
    """All keys under which ROS nodes look for us."""
    return [name for keys in every_topic(settings) for name in (keys, f"{keys}/@adv/**", f"@ros2_lv/{keys}")]


def every_topic(settings: Ros) -> list[str]:
    """The keys of all topics of its domain, those of other nodes too."""
    return [] if settings.distro == "off" else [f"{settings.domain}/**"]


def node_token(settings: Ros, zid: str) -> str:
    """What makes the node visible; `zid`: of the Zenoh session."""
    return f"@ros2_lv/{settings.domain}/{zid}/{NODE_ID}/{NODE_ID}/NN/%/{_mangled(settings.namespace)}/{NODE}"


def publisher_token(settings: Ros, zid: str, number: int, topic: Topic) -> str:
    """What makes a publisher of the node visible."""
    name = _mangled(str(topic.ros_name(settings.namespace)))
    node = f"%/{_mangled(settings.namespace)}/{NODE}"
    return f"@ros2_lv/{settings.domain}/{zid}/{NODE_ID}/{number}/MP/{node}/{name}/{_type(settings, topic)}/{quality(topic)}"


def quality(topic: Topic) -> str:
    """rmw_zenoh's word for the topic's quality of service, where what is usual is left out: reliability (reliable), durability (volatile),
    history and depth (keep last), deadline, lifespan and liveliness (none)."""
    return f":{'1' if topic.kept else ''}:,{'' if topic.depth == DEFAULT_DEPTH else topic.depth}:,:,:,,"


def gid(token: str) -> bytes:
    """A publisher's id of 16 bytes, from its token."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(16, "little")


def _type(settings: Ros, topic: Topic) -> str:
    """The type's name and hash, as keys hold them."""
    package, _, name = str(topic.type).split("/")
    return f"{package}::msg::dds_::{name}_/" + (
        "TypeHashNotSupported" if settings.distro == "humble" else f"RIHS01_{HASHES[str(topic.type)]}"
    )


def _mangled(name: str) -> str:
    return name.replace("/", "%")
