"""Detections as points against rosbags, byte for byte, and against bytes that mean harm."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.cdr_messages import NAMES, POINTS_OF_TWO, ROS, STAMPS, STORE, patched, ros_header

from echogrid.topics.points import JudgedPoints, Points, decode_judged, decode_points, encode_judged, encode_points

POINTS = st.builds(
    Points,
    STAMPS,
    NAMES,
    st.lists(st.tuples(*[st.floats(-1e7, 1e7, width=32)] * 3), max_size=9).map(lambda rows: np.array(rows, np.float32).reshape(-1, 3)),
)


def _ros_points(points: Points) -> object:
    float32 = ROS["sensor_msgs/msg/PointField"].FLOAT32
    fields = [ROS["sensor_msgs/msg/PointField"](name, offset, float32, 1) for name, offset in (("x", 0), ("y", 4), ("z", 8))]
    data = np.frombuffer(points.points.tobytes(), dtype=np.uint8)
    return ROS["sensor_msgs/msg/PointCloud2"](
        header=ros_header(points.stamp_ns, points.frame),
        height=1,
        width=len(points.points),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=len(data),
        data=data,
        is_dense=True,
    )


@given(POINTS)
def test_points_are_what_rosbags_writes_and_come_back(points: Points) -> None:
    payload = encode_points(points)
    assert payload == bytes(STORE.serialize_cdr(_ros_points(points), "sensor_msgs/msg/PointCloud2"))
    back = decode_points(payload)
    assert (back.stamp_ns, back.frame) == (points.stamp_ns, points.frame)
    np.testing.assert_array_equal(back.points, points.points)


# For the frame "base": height 20, width 24, fields 28, 32 ("x": length, name, offset 40, datatype 44, count 48) ..., 92 is_bigendian,
# point_step 96, row_step 100, size 104, data 108, is_dense 132.
@pytest.mark.parametrize(
    ("at", "layout", "values", "message"),
    [
        (20, "<I", (2,), "not laid out"),
        (24, "<I", (3,), "3 points declare"),
        (24, "<I", (2**32 - 1,), "4294967295 points declare"),
        (28, "<I", (2,), "not laid out"),
        (28, "<I", (2**32 - 1,), "message ends|name of|not laid out"),
        (40, "<I", (4,), "not laid out"),
        (44, "<B", (8,), "not laid out"),
        (48, "<I", (2,), "not laid out"),
        (92, "<B", (1,), "not laid out"),
        (96, "<I", (16,), "not laid out"),
        (100, "<I", (12,), "bytes and hold"),
        (104, "<I", (2**32 - 1,), "bytes and hold"),
        (108, "<f", (math.nan,), "not a number"),
        (132, "<B", (0,), "bytes and hold"),
    ],
)
def test_points_that_cannot_be_are_refused(at: int, layout: str, values: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        decode_points(patched(encode_points(POINTS_OF_TWO), at, layout, *values))


ROWS = st.tuples(*[st.floats(-1e7, 1e7, width=32)] * 3, st.integers(0, 255), st.integers(0, 2))
JUDGED = st.builds(
    lambda stamp_ns, frame, rows: JudgedPoints(
        stamp_ns,
        frame,
        np.array([row[:3] for row in rows], np.float32).reshape(-1, 3),
        np.array([row[3] for row in rows], np.uint8),
        np.array([row[4] for row in rows], np.uint8),
    ),
    STAMPS,
    NAMES,
    st.lists(ROWS, max_size=9),
)


@given(JUDGED)
def test_judged_points_are_what_rosbags_writes_and_come_back(judged: JudgedPoints) -> None:
    field, count = ROS["sensor_msgs/msg/PointField"], len(judged.points)
    layout = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("radar", 12, 2), ("verdict", 13, 2)]
    data = b"".join(
        row.tobytes() + bytes((radar, verdict, 0, 0))
        for row, radar, verdict in zip(judged.points, judged.radars, judged.verdicts, strict=True)
    )
    message = ROS["sensor_msgs/msg/PointCloud2"](
        header=ros_header(judged.stamp_ns, judged.frame),
        height=1,
        width=count,
        fields=[field(name, offset, kind, 1) for name, offset, kind in layout],
        is_bigendian=False,
        point_step=16,
        row_step=16 * count,
        data=np.frombuffer(data, dtype=np.uint8),
        is_dense=True,
    )
    payload = encode_judged(judged)
    assert payload == bytes(STORE.serialize_cdr(message, "sensor_msgs/msg/PointCloud2"))
    back = decode_judged(payload)
    assert (back.stamp_ns, back.frame) == (judged.stamp_ns, judged.frame)
    for name in ("points", "radars", "verdicts"):
        np.testing.assert_array_equal(getattr(back, name), getattr(judged, name))


def test_judged_points_of_no_verdict_are_refused() -> None:
    judged = JudgedPoints(1, "base", np.zeros((1, 3), np.float32), np.zeros(1, np.uint8), np.array([3], np.uint8))
    with pytest.raises(ValueError, match="a verdict of 3, expected at most 2"):
        decode_judged(encode_judged(judged))
