"""The live view, seen by a plain WebSocket client and decoded by rosbags."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from tests.support.foxglove_client import viewer
from tests.support.mcap_files import decoder
from tests.support.waiting import PATIENCE

from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.recording.foxglove import Foxglove
from echogrid.topics.poses import Odometry, encode_odometry
from echogrid.topics.topic import META, ODOMETRY, STATUS, TOPICS, Message

STAMP_NS = 1732547000_123456789
POSE = Message(ODOMETRY, encode_odometry(Odometry(STAMP_NS, "odom", "base", SE2(1.5, -2.0, 0.5), 3.0, 0.1)), STAMP_NS, 1, 0)


def test_a_viewer_sees_all_topics_with_their_definitions_and_gets_the_very_bytes() -> None:
    with Foxglove("127.0.0.1", 0, "car") as sink, viewer(sink.port) as view:
        assert view.server["name"] == "echogrid car"
        assert view.server["capabilities"] == []  # a viewer may change nothing
        assert {channel["schemaName"] for channel in view.channels.values()} >= {topic.type for topic in TOPICS if topic.type is not None}
        assert len(view.channels) == len(TOPICS)
        view.subscribe(["/echogrid/odom"])
        while (got := view.receive(0.05)) is None:  # a subscription takes a moment
            sink.put(POSE)
        assert got == (0, STAMP_NS, POSE.payload)
        channel = view.channels["/echogrid/odom"]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        message = decoder()(channel["schemaName"], channel["schema"], got[2])
        assert (message.pose.pose.position.x, message.twist.twist.linear.x) == (1.5, 3.0)


def test_who_comes_later_gets_what_was_said_once() -> None:
    with Foxglove("127.0.0.1", 0, "car") as sink:
        sink.put(Message(META, b'{"vehicle": "car"}', 1, 0, 0))
        with viewer(sink.port) as view:
            view.subscribe(["/echogrid/meta"])
            while (got := view.receive(0.05)) is None:
                sink.put(Message(STATUS, b"{}", STAMP_NS, 1, 0))
            assert got == (0, STAMP_NS, b'{"vehicle": "car"}')
            assert json.loads(view.channels["/echogrid/meta"]["schema"])["type"] == "object"


def test_an_address_that_is_taken_is_one_sentence() -> None:
    with Foxglove("127.0.0.1", 0, "car") as first:
        for host, port in (("127.0.0.1", first.port), ("192.0.2.1", 8765)):
            with pytest.raises(EchogridError, match=f"--foxglove: {host}:{port} cannot be listened on: [^\n]+$"):
                Foxglove(host, port, "car")


def test_without_the_extra_the_sentence_names_it() -> None:
    code = "import sys; sys.modules['foxglove'] = None; from echogrid.recording.foxglove import Foxglove; Foxglove('127.0.0.1', 0, 'car')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.stderr.splitlines()[-1].endswith("foxglove-sdk is not installed: pip install foxglove-sdk")
