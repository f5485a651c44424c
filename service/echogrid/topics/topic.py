"""What echogrid says, topic by topic: names, types and quality of service. docs/interface.md is the contract."""

from __future__ import annotations

from typing import Protocol

import msgspec

NAMESPACE = "/echogrid"  # of the ROS topics, unless [ros] says another


class Topic(msgspec.Struct, frozen=True):
    """A stream of messages of one type."""

    name: str  # behind echogrid/v1/{vehicle}/
    type: str | None  # of ROS, in CDR; None: a JSON object
    ros: str | None = None  # its name under ROS
    kept: bool = False  # the last message reaches late subscribers; ROS: transient local
    depth: int = 1  # of ROS's history: keep last
    rank: int = 0  # what has a smaller one goes first, and nothing is held up by what has a larger one; from 1 on it is a grid
    packed: bool = False  # zstd of it

    def ros_name(self, namespace: str) -> str | None:
        """Its name with `namespace` in place of NAMESPACE; "/" is none. Topics that ROS knows by one name, as /tf, keep it."""
        if self.ros is None or not self.ros.startswith(f"{NAMESPACE}/"):
            return self.ros
        return namespace.rstrip("/") + self.ros.removeprefix(NAMESPACE)


FULL = Topic("grid/fused/full", "nav_msgs/msg/OccupancyGrid", kept=True, rank=2)
KEY = Topic("grid/fused/key", "nav_msgs/msg/OccupancyGrid", "/echogrid/map", kept=True, rank=1)
UPDATE = Topic("grid/fused/update", "map_msgs/msg/OccupancyGridUpdate", "/echogrid/map_updates", depth=5, rank=1)
ODOMETRY = Topic("odom", "nav_msgs/msg/Odometry", "/echogrid/odom", depth=10)
TRANSFORM = Topic("tf", "tf2_msgs/msg/TFMessage", "/tf", depth=100)
DETECTIONS = Topic("detections", "sensor_msgs/msg/PointCloud2", "/echogrid/detections", depth=5)
JUDGED = Topic("detections/judged", "sensor_msgs/msg/PointCloud2", "/echogrid/detections_judged", depth=5)
STATUS = Topic("status", None)
DIAGNOSTICS = Topic("diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", depth=10)
META = Topic("meta", None, kept=True)
TRINARY = Topic("grid/fused/trinary", "nav_msgs/msg/OccupancyGrid", "/echogrid/map_trinary", kept=True, rank=1)  # of each key frame
FLEET = Topic("grid/fused/fleet", "nav_msgs/msg/OccupancyGrid", rank=3, packed=True)  # made of FULL, where somebody listens
RUN = "alive/run"  # behind it each run of a service has a liveliness token, by its source
ALIVE, REGION, TILE = "alive/fusion", "grid/fused/region", "grid/fused/tile"  # a liveliness token, and what is asked for
TOPICS = (FULL, KEY, UPDATE, ODOMETRY, TRANSFORM, DETECTIONS, JUDGED, STATUS, DIAGNOSTICS, META, TRINARY)


class Message(msgspec.Struct, frozen=True, eq=False):
    """One message of a topic, encoded once for all who take it."""

    topic: Topic
    payload: bytes  # CDR or JSON, as the topic's type says
    stamp_ns: int  # when its content was measured, Unix time
    epoch: int  # of the map
    keyframe: int  # KEY: its number, from 1. UPDATE: that of the key frame for which it was made. Else 0


class Sink(Protocol):
    """Where messages go. One thread puts; any may ask."""

    def wants(self, *topics: Topic) -> bool:
        """Whether somebody takes any of the topics' messages now."""

    def put(self, message: Message) -> None:
        """Takes a message without waiting for its readers. Raises EchogridError if it can take no more of them."""
