"""Recordings as libraries of other makes read them: all of the file at once, and each kind of message field by field."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from tests.support import world

from echogrid.commands.replay import replay
from echogrid.logs.drive import find_drive
from echogrid.topics.grids import decode_grid, decode_update
from echogrid.topics.points import decode_points
from echogrid.topics.poses import decode_odometry

schemas = pytest.importorskip("edgefirst.schemas", reason="edgefirst-schemas is not installed (requirements/develop.in)")
mcap_ros2 = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support is not installed (requirements/develop.in)")
Rows = list[tuple[str, bytes]]  # topic and payload


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drive")
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 120)])
    drive = world.write_drive(folder, world.record(world.circle(6.0, 0.1), [wall], 3.0))
    replay(find_drive(drive, None), folder / "out", record=folder / "a.mcap")
    return folder / "a.mcap"


@pytest.fixture(scope="module")
def rows(recording: Path) -> Rows:
    with recording.open("rb") as file:
        return [(channel.topic, message.data) for _, channel, message in make_reader(file).iter_messages()]


def of(rows: Rows, topic: str) -> list[bytes]:
    found = [data for name, data in rows if name == topic]
    assert found
    return found


def test_mcap_ros2_support_reads_all_of_it(recording: Path, rows: Rows) -> None:
    """Without a word of topics, in the file's order."""
    read: list[tuple[str, Any]] = [(one.channel.topic, one.ros_msg) for one in mcap_ros2.read_ros2_messages(str(recording))]
    assert Counter(topic for topic, _ in read) == Counter(topic for topic, _ in rows)
    maps = [message for topic, message in read if topic == "/echogrid/map"]
    for theirs, ours in zip(maps, map(decode_grid, of(rows, "/echogrid/map")), strict=True):
        assert (np.array(theirs.data, np.int8) == ours.occupancy.reshape(-1)).all()
        assert (theirs.info.origin.position.x, theirs.info.origin.position.y) == ours.origin
    updates = [message for topic, message in read if topic == "/echogrid/map_updates"]
    for theirs, update in zip(updates, map(decode_update, of(rows, "/echogrid/map_updates")), strict=True):
        assert (np.array(theirs.data, np.int8) == update.occupancy.reshape(-1)).all()
    frames = [message for topic, message in read if topic == "/can/can0"]
    assert all(frame.len == len(frame.data) for frame in frames)


def test_edgefirst_schemas_reads_maps_poses_and_points(rows: Rows) -> None:
    """Its cells are unsigned: what is unknown, -1, is 255 there."""
    for data in of(rows, "/echogrid/map") + of(rows, "/echogrid/map_trinary"):
        theirs, ours = schemas.nav_msgs.OccupancyGrid.from_cdr(data), decode_grid(data)
        cells = np.frombuffer(theirs.data, np.uint8)
        assert (cells.view(np.int8) == ours.occupancy.reshape(-1)).all()
        assert (cells == 255).sum() == (ours.occupancy == -1).sum()
        height, width = ours.occupancy.shape
        info, place = theirs.info, theirs.info.origin.position
        assert (info.width, info.height, info.resolution) == (width, height, np.float32(ours.cell))
        assert (place.x, place.y) == ours.origin
        assert (theirs.frame_id, theirs.stamp.sec * 10**9 + theirs.stamp.nanosec) == (ours.frame, ours.stamp_ns)
    for data in of(rows, "/echogrid/odom"):
        odometry, pose = decode_odometry(data), schemas.nav_msgs.Odometry.from_cdr(data).pose.pose
        assert (pose.position.x, pose.position.y) == (odometry.pose.x, odometry.pose.y)
    for data in of(rows, "/echogrid/detections"):
        points, cloud = decode_points(data), schemas.sensor_msgs.PointCloud2.from_cdr(data)
        assert (cloud.width * cloud.height, len(cloud.data)) == (len(points.points), cloud.row_step * cloud.height)
