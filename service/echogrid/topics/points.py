"""Detections as ROS's point cloud in CDR (`cdr`), and back."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.topics.cdr import LITTLE_ENDIAN, aligned, body_of, encode_header, encode_text, padded, read, read_header, read_text

_SHAPE = struct.Struct("<III")  # height, width, number of fields
_FIELD = struct.Struct("<IBxxxI")  # offset, datatype, count
_STEPS = struct.Struct("<BxxxIII")  # is_bigendian, point_step, row_step, length of data
_FLOAT32 = 7  # sensor_msgs/PointField's number for it


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """sensor_msgs/PointCloud2 of x, y and z alone, unordered."""

    stamp_ns: int
    frame: str
    points: NDArray[np.float32]  # (N, 3) m, x, y, z in frame


def encode_points(points: Points) -> bytes:
    """The points as sensor_msgs/msg/PointCloud2: float32 x, y, z, one after the other, all finite."""
    count = len(points.points)
    body = encode_header(points.stamp_ns, points.frame) + _SHAPE.pack(1, count, 3)
    for number, name in enumerate("xyz"):
        body = padded(body + encode_text(name), 4) + _FIELD.pack(4 * number, _FLOAT32, 1)
    body += _STEPS.pack(0, 12, 12 * count, 12 * count)
    return b"".join((LITTLE_ENDIAN, body, points.points.astype("<f4", copy=False).tobytes(), b"\1"))


def decode_points(payload: bytes) -> Points:
    """The points of a sensor_msgs/msg/PointCloud2 that is laid out as `encode_points` does; a read-only view of the payload."""
    body = body_of(payload)
    stamp_ns, frame, at = read_header(body)
    height, width, fields = read(_SHAPE, body, at)
    at += _SHAPE.size
    layout = []
    for _ in range(min(fields, 4)):
        name, at = read_text(body, at)
        at = aligned(at, 4)
        layout.append((name, *read(_FIELD, body, at)))
        at += _FIELD.size
    big_endian, point_step, row_step, size = read(_STEPS, body, at)
    at += _STEPS.size
    expected = [(name, 4 * number, _FLOAT32, 1) for number, name in enumerate("xyz")]
    if (height, layout, big_endian, point_step) != (1, expected, 0, 12):
        raise ValueError("the points are not laid out as float32 x, y, z, one after the other")
    if size != row_step or size != 12 * width or len(body) != at + size + 1 or body[-1] != 1:
        raise ValueError(f"{width} points declare {size} bytes and hold {len(body) - at - 1}")
    points = np.frombuffer(body[at:-1], dtype="<f4").reshape(-1, 3)
    if not np.isfinite(points).all():
        raise ValueError("the points hold something that is not a number")
    return Points(stamp_ns, frame, points)
