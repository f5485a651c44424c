"""What ROS 2 nodes see of us: names, types and hashes by rosbags, and a subscriber of other people's making."""

from __future__ import annotations

import json
import os
import re
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xxhash
import zenoh
import zenoh.ext
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from tests.support import messages
from tests.support.waiting import PATIENCE, until

from echogrid.config.tables import Publish, Ros
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.topics.grids import GridUpdate, encode_update
from echogrid.topics.points import JudgedPoints, Points, encode_judged, encode_points
from echogrid.topics.poses import Transform, encode_transforms
from echogrid.topics.topic import DETECTIONS, JUDGED, KEY, TOPICS, TRANSFORM, TRINARY, UPDATE, Message
from echogrid.zenoh import ros
from echogrid.zenoh.attachment import decode_attachment
from echogrid.zenoh.publisher import Publisher, session_config

STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(
    get_types_from_msg(
        "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data", "map_msgs/msg/OccupancyGridUpdate"
    )
)
NAMES = {"map", "map_trinary", "map_updates", "odom", "detections"}  # in our namespace
LOG_ODDS = np.array([[0, 3.5, -3.5], [1, 0, 0]], dtype=np.float32)


def publish(port: int, settings: Ros) -> Publisher:
    return Publisher(Publish(listen=(f"tcp/127.0.0.1:{port}",)), "car", settings)


@pytest.mark.parametrize("name", sorted(ros.HASHES))
def test_every_type_has_the_hash_that_rosbags_works_out(name: str) -> None:
    assert f"RIHS01_{ros.HASHES[name]}" == STORE.hash_rihs01(name)


def test_every_topic_of_ros_has_a_hash() -> None:
    assert {topic.type for topic in TOPICS if topic.ros is not None} == set(ros.HASHES)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        (Ros(), f"0/echogrid/map/nav_msgs::msg::dds_::OccupancyGrid_/RIHS01_{ros.HASHES['nav_msgs/msg/OccupancyGrid']}"),
        (Ros(distro="humble", domain=7, namespace="/a/b"), "7/a/b/map/nav_msgs::msg::dds_::OccupancyGrid_/TypeHashNotSupported"),
        (
            Ros(namespace="/", domain=232),
            f"232/map/nav_msgs::msg::dds_::OccupancyGrid_/RIHS01_{ros.HASHES['nav_msgs/msg/OccupancyGrid']}",
        ),
    ],
)
def test_keys_are_as_rmw_zenohs_design_says(settings: Ros, key: str) -> None:
    assert dict(ros.topic_keys(settings))[KEY] == key


def test_tokens_are_as_rmw_zenohs_design_says() -> None:
    """Its examples, with our names: inner slashes become %, what is usual in the quality of service is left out."""
    settings = Ros(namespace="/ego/grid")
    assert ros.node_token(settings, "aac3178e") == "@ros2_lv/0/aac3178e/0/0/NN/%/%ego%grid/echogrid"
    token = "@ros2_lv/0/aac3178e/0/3/MP/%/%ego%grid/echogrid/%ego%grid%map/nav_msgs::msg::dds_::OccupancyGrid_/"
    assert ros.publisher_token(settings, "aac3178e", 3, KEY) == f"{token}RIHS01_{ros.HASHES['nav_msgs/msg/OccupancyGrid']}/:1:,1:,:,:,,"
    assert "/MP/%/%/echogrid/%tf/" in ros.publisher_token(Ros(namespace="/"), "aac3178e", 3, TRANSFORM)
    assert ros.quality(UPDATE) == "::,5:,:,:,,"  # what RViz's map display asks for


def test_a_publishers_id_is_its_tokens_hash_lowest_half_first() -> None:
    token = "@ros2_lv/0/aac3178e/0/3/MP/%/%/echogrid/%tf/x/y/::,:,:,:,,"
    high, low = struct.unpack(">QQ", xxhash.xxh3_128_digest(token.encode()))
    assert ros.gid(token) == struct.pack("<QQ", low, high)


@pytest.mark.parametrize("distro", ["humble", "jazzy"])
def test_a_node_that_comes_late_gets_the_map_as_rmw_zenoh_asks_for_it(port: int, distro: str) -> None:
    """With an inner slash in the name, by the subscriber that rmw_zenoh declares for transient local."""
    settings = Ros(distro=distro)
    with publish(port, settings) as publisher:
        publisher.put(messages.grid(41, 0, 0, 0.5, LOG_ODDS, topic=KEY, keyframe=1))
        publisher.put(messages.grid(42, 0, 0, 0.5, LOG_ODDS, topic=KEY, keyframe=2))
        with zenoh.open(session_config((), (f"tcp/127.0.0.1:{port}",), sends=False)) as session:
            subscriber = zenoh.ext.declare_advanced_subscriber(
                session,
                dict(ros.topic_keys(settings))[KEY],
                zenoh.handlers.DefaultHandler(),
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
                recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                subscriber_detection=True,
            )
            sample = until(subscriber.try_recv)
    sequence, stamp_ns, gid = decode_attachment(bytes(sample.attachment))
    token = ros.publisher_token(settings, str(sample.timestamp.get_id()), 1, KEY)
    assert (sequence, stamp_ns, gid) == (2, 42, ros.gid(token))
    message = STORE.deserialize_cdr(bytes(sample.payload), "nav_msgs/msg/OccupancyGrid")
    np.testing.assert_array_equal(message.data, [-1, 97, 3, 73, -1, -1])


def test_off_is_off(port: int) -> None:
    with (
        publish(port, Ros(distro="off")) as publisher,
        zenoh.open(session_config((), (f"tcp/127.0.0.1:{port}",), sends=False)) as session,
    ):
        subscriber = session.declare_subscriber("0/**")
        native = session.declare_subscriber("echogrid/v1/car/**")
        until(native.try_recv, lambda: publisher.put(messages.odometry(EgoState(1, SE2(0, 0, 0), 0, 0))))
        assert subscriber.try_recv() is None
        assert [reply for reply in session.liveliness().get("@ros2_lv/**", timeout=1.0) if reply.ok is not None] == []


NODE = """
import json, os, sys, time
from pathlib import Path

import numpy as np
from zenoh_ros2_sdk import ROS2Subscriber
from zenoh_ros2_sdk.discovery import get_topic_info, get_topic_names_and_types
from zenoh_ros2_sdk.message_registry import get_registry
from zenoh_ros2_sdk.qos import QosDurability, QosProfile
from zenoh_ros2_sdk.session import ZenohSession

port, folder, patience, count = int(sys.argv[1]), sys.argv[2], float(sys.argv[4]), int(sys.argv[5])
session = ZenohSession.get_instance("127.0.0.1", port)
get_registry().messages_dir = Path(folder)


def plain(value):
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype != object else [plain(item) for item in value]
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    return value


deadline = time.monotonic() + patience
while len(topics := get_topic_names_and_types(0, "127.0.0.1", port, timeout=1.0)) < count and time.monotonic() < deadline:
    pass
infos = {}
while len(infos) < len(topics) and time.monotonic() < deadline:
    found = {name: get_topic_info(name, 0, "127.0.0.1", port, timeout=1.0, verbose=True) for name, _ in topics if name not in infos}
    infos |= {name: info for name, info in found.items() if info is not None and info.publishers}
told = {"topics": topics, "hashes": {name: info.publishers[0].type_hash for name, info in infos.items()}}
wanted = json.loads(sys.argv[3])
subscribers = []
for name, kind, late in wanted:
    qos = QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1) if late else None
    take = lambda message, name=name: told.setdefault(name, plain(message))
    subscribers.append(ROS2Subscriber(name, kind, take, router_port=port, qos=qos))
while not told.keys() >= {name for name, _, _ in wanted} and time.monotonic() < deadline:
    time.sleep(0.01)
print(json.dumps(told))
for subscriber in subscribers:
    subscriber.close()
session.close()
"""


def place_messages(folder: Path) -> None:
    """The definitions of all types where the node looks first, so that it looks nowhere else."""
    for name in ros.HASHES:
        text, _ = STORE.generate_msgdef(name, ros_version=2)
        own, *others = re.split(r"={80}\nMSG: (\S+)\n", text)
        for kind, definition in [(name, own), *zip(others[::2], others[1::2], strict=True)]:
            package, _, message = kind.rpartition("/")
            path = folder / package.removesuffix("/msg") / "msg" / f"{message}.msg"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(definition)


def everything(stamp_ns: int) -> list[Message]:
    """One message of each topic that moves."""
    pose = SE2(3.0, -4.0, 0.5)
    update = GridUpdate(stamp_ns, "odom", 1, 0, np.array([[7, 8]], np.int8))
    points = Points(stamp_ns, "base", np.array([[1, 2, 0]], np.float32))
    judged = JudgedPoints(stamp_ns, "base", points.points, np.array([2], np.uint8), np.array([1], np.uint8))
    return [
        messages.odometry(EgoState(stamp_ns, pose, 8.5, -0.125)),
        Message(UPDATE, encode_update(update), stamp_ns, 0, 1),
        Message(TRANSFORM, encode_transforms((Transform(stamp_ns, "odom", "base", pose),)), stamp_ns, 0, 0),
        Message(DETECTIONS, encode_points(points), stamp_ns, 0, 0),
        Message(JUDGED, encode_judged(judged), stamp_ns, 0, 0),
        messages.grid(stamp_ns, -3, 10, 0.5, LOG_ODDS, topic=TRINARY, keyframe=1),
    ]


@pytest.mark.parametrize("namespace", ["/", "/echogrid"])
def test_a_node_of_other_peoples_making_sees_and_understands_all(port: int, tmp_path: Path, namespace: str) -> None:
    """zenoh-ros2-sdk lists the topics, gets the map though it comes late, and decodes what comes then.

    Its 0.1.8 finds no publisher of a name with inner slashes when it looks for old samples, so there the map is sent once more.
    """
    place_messages(tmp_path / "messages")
    under = {topic.ros_name(namespace): topic for topic in TOPICS if topic.ros is not None}
    wanted = [(name, topic.type, topic is KEY and namespace == "/") for name, topic in under.items() if name != "/diagnostics"]
    arguments = [str(port), str(tmp_path / "messages"), json.dumps(wanted), str(PATIENCE), str(len(under))]
    own = {"HOME": str(tmp_path), "PATH": os.environ["PATH"], "https_proxy": "http://127.0.0.1:9"}  # it would clone and set up git else
    grid = messages.grid(42, -3, 10, 0.5, LOG_ODDS, topic=KEY, keyframe=1)
    with publish(port, Ros(namespace=namespace)) as publisher:
        publisher.put(grid)
        with subprocess.Popen([sys.executable, "-c", NODE, *arguments], env=own, stdout=subprocess.PIPE, text=True) as node:
            while node.poll() is None:  # it ends by itself
                for message in everything(1_700_000_000_000_000_005) + [grid] * (namespace != "/"):
                    publisher.put(message)
                time.sleep(0.02)
            assert node.stdout is not None
            told: dict[str, Any] = json.loads(node.stdout.read())
    assert not (tmp_path / ".gitconfig").exists()
    assert told.keys() >= {name for name, _, _ in wanted}
    assert dict(told["topics"]) == {name: [topic.type] for name, topic in under.items()}
    assert told["hashes"] == {name: STORE.hash_rihs01(str(topic.type)) for name, topic in under.items()}
    at = namespace.rstrip("/")
    assert told[f"{at}/map"]["data"] == [-1, 97, 3, 73, -1, -1]
    assert told[f"{at}/map"]["info"]["origin"]["position"] == {"x": 5.0, "y": -1.5, "z": 0.0}
    update = told[f"{at}/map_updates"]
    assert {key: update[key] for key in ("x", "y", "width", "height", "data")} == {"x": 1, "y": 0, "width": 2, "height": 1, "data": [7, 8]}
    assert told[f"{at}/odom"]["twist"]["twist"]["linear"]["x"] == 8.5
    assert told[f"{at}/odom"]["header"]["stamp"] == {"sec": 1_700_000_000, "nanosec": 5}
    (transform,) = told["/tf"]["transforms"]
    assert (transform["header"]["frame_id"], transform["child_frame_id"]) == ("odom", "base")
    assert [field["name"] for field in told[f"{at}/detections"]["fields"]] == ["x", "y", "z"]
    assert np.frombuffer(bytes(told[f"{at}/detections"]["data"]), "<f4").tolist() == [1, 2, 0]
