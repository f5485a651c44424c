"""Messages in CDR for tests: rosbags' own types of them, examples, and what Hypothesis makes them of."""

from __future__ import annotations

import math
import struct

import numpy as np
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from echogrid.core.motion.se2 import SE2
from echogrid.topics.cdr import SECOND
from echogrid.topics.diagnostic_array import DiagnosticArray, DiagnosticStatus, Level
from echogrid.topics.grids import Grid
from echogrid.topics.points import Points
from echogrid.topics.poses import Odometry, Transform

STORE = get_typestore(Stores.ROS2_HUMBLE)
UPDATE = "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data"  # no part of rosbags' own

STORE.register(get_types_from_msg(UPDATE, "map_msgs/msg/OccupancyGridUpdate"))
ROS = STORE.types
FRAMES = ("", "m", "ab", "map", "odom", "base_link", "straße/über")
NUMBERS = st.floats(-1e7, 1e7)
NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=20)
STAMPS = st.integers(-(2**31) * SECOND, 2**31 * SECOND - 1)
CELLS = st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(0, 2**32 - 1)).map(
    lambda shape: np.random.default_rng(shape[2]).integers(-1, 101, shape[:2], dtype=np.int8)
)
POINTS_OF_TWO = Points(7, "base", np.arange(6, dtype=np.float32).reshape(2, 3))


def ros_header(stamp_ns: int, frame: str) -> object:
    stamp = ROS["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return ROS["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def ros_pose(x: float, y: float, z: float, w: float) -> object:
    point = ROS["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
    return ROS["geometry_msgs/msg/Pose"](position=point, orientation=ROS["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=z, w=w))


def grid_of(frame: str = "odom", height: int = 3, width: int = 4) -> Grid:
    occupancy = (np.arange(height * width, dtype=np.int64) % 102 - 1).astype(np.int8).reshape(height, width)
    return Grid(1_700_000_000_123_456_789, frame, 0.234375, (-15.5, 7.25), occupancy)


def odometry_of(frame: str = "odom", child_frame: str = "base") -> Odometry:
    covariance = np.arange(36.0).reshape(6, 6)
    return Odometry(-1, frame, child_frame, SE2(1.5, -2.5, 2.0), 13.9, -0.25, covariance, covariance + 0.5)


def diagnostics_of(frame: str = "") -> DiagnosticArray:
    service = DiagnosticStatus(Level.WARN, "echogrid: service", "", "car", {})
    radar = DiagnosticStatus(Level.STALE, "echogrid: radar fl", "silent", "fl", {"late": "3", "": "", "ratio": "0.5"})
    return DiagnosticArray(1_700_000_000_123_456_789, frame, (service, radar))


def transforms_of(payload: bytes) -> list[Transform]:
    """A tf2_msgs/msg/TFMessage of turns about z, as rosbags reads it."""
    found = []
    for one in STORE.deserialize_cdr(payload, "tf2_msgs/msg/TFMessage").transforms:
        stamp, place, turn = one.header.stamp, one.transform.translation, one.transform.rotation
        assert (place.z, turn.x, turn.y) == (0.0, 0.0, 0.0)
        pose = SE2(place.x, place.y, 2.0 * math.atan2(turn.z, turn.w))
        found.append(Transform(stamp.sec * SECOND + stamp.nanosec, one.header.frame_id, one.child_frame_id, pose))
    return found


def patched(payload: bytes, at: int, layout: str, *values: float) -> bytes:
    """The payload with other values at an offset counted behind the encapsulation header."""
    changed = bytearray(payload)
    struct.pack_into(layout, changed, 4 + at, *values)
    return bytes(changed)
