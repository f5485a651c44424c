"""Detections as ROS's point cloud in CDR (`cdr`), and back."""

from __future__ import annotations

import struct
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.topics.cdr import LITTLE_ENDIAN, aligned, body_of, encode_header, encode_name, read, read_header, read_text

_SHAPE = struct.Struct("<III")  # height, width, number of fields
_FIELD = struct.Struct("<IBxxxI")  # offset, datatype, count
_STEPS = struct.Struct("<BxxxIII")  # is_bigendian, point_step, row_step, length of data
_UINT8, _FLOAT32 = 2, 7  # sensor_msgs/PointField's numbers for them


class _Layout(NamedTuple):
    """How the points of a message lie in it."""

    fields: list[tuple[str, int, int, int]]  # each one's name, offset, datatype and count
    step: int  # bytes of a point
    encoded: bytes  # the fields, as they stand in each message

    @classmethod
    def of(cls, step: int, *fields: tuple[str, int, int, int]) -> _Layout:
        """Of these fields; what is before them ends at a multiple of 4, and so do they."""
        return cls(list(fields), step, b"".join(encode_name(name) + _FIELD.pack(*layout) for name, *layout in fields))


_XYZ = [(name, 4 * number, _FLOAT32, 1) for number, name in enumerate("xyz")]
_PLACE = _Layout.of(12, *_XYZ)
_JUDGED = _Layout.of(16, *_XYZ, ("radar", 12, _UINT8, 1), ("verdict", 13, _UINT8, 1))
_RECORD = np.dtype({"names": ["place", "radar", "verdict"], "formats": ["(3,)<f4", "u1", "u1"], "offsets": [0, 12, 13], "itemsize": 16})
MOST_VERDICT = 2  # the numbers of verdicts begin with 0


class Points(msgspec.Struct, frozen=True, eq=False):
    """sensor_msgs/PointCloud2 of x, y and z alone, unordered."""

    stamp_ns: int
    frame: str
    points: NDArray[np.float32]  # (N, 3) m, x, y, z in frame


class JudgedPoints(msgspec.Struct, frozen=True, eq=False):
    """The same with the radar that measured each, by its number in `meta`, and what the gate said of it: 0 static, 1 moving, 2 beside
    some that move, and dropped with them."""

    stamp_ns: int
    frame: str
    points: NDArray[np.float32]  # (N, 3) m, x, y, z in frame
    radars: NDArray[np.uint8]  # (N,)
    verdicts: NDArray[np.uint8]  # (N,)


def encode_points(points: Points) -> bytes:
    """The points as sensor_msgs/msg/PointCloud2: float32 x, y, z, one after the other, all finite."""
    return _encode(points.stamp_ns, points.frame, _PLACE, points.points.astype("<f4", copy=False).tobytes())


def decode_points(payload: bytes) -> Points:
    """The points of a sensor_msgs/msg/PointCloud2 that is laid out as `encode_points` does; a read-only view of the payload."""
    stamp_ns, frame, data = _decode(payload, _PLACE, "float32 x, y, z, one after the other")
    return Points(stamp_ns, frame, _finite(np.frombuffer(data, dtype="<f4").reshape(-1, 3)))


def encode_judged(judged: JudgedPoints) -> bytes:
    """The points as sensor_msgs/msg/PointCloud2: float32 x, y, z, uint8 radar and verdict, 16 bytes each, all finite."""
    records = np.zeros(len(judged.points), dtype=_RECORD)
    records["place"], records["radar"], records["verdict"] = judged.points, judged.radars, judged.verdicts
    return _encode(judged.stamp_ns, judged.frame, _JUDGED, records.tobytes())


def decode_judged(payload: bytes) -> JudgedPoints:
    """The points of a sensor_msgs/msg/PointCloud2 that is laid out as `encode_judged` does."""
    stamp_ns, frame, data = _decode(payload, _JUDGED, "float32 x, y, z, uint8 radar, verdict in 16 bytes")
    records = np.frombuffer(data, dtype=_RECORD)
    if records["verdict"].max(initial=0) > MOST_VERDICT:
        raise ValueError(f"a verdict of {records['verdict'].max()}, expected at most {MOST_VERDICT}")
    return JudgedPoints(stamp_ns, frame, _finite(records["place"]), records["radar"], records["verdict"])


def _encode(stamp_ns: int, frame: str, layout: _Layout, data: bytes) -> bytes:
    size = len(data)
    shape, steps = _SHAPE.pack(1, size // layout.step, len(layout.fields)), _STEPS.pack(0, layout.step, size, size)
    return b"".join((LITTLE_ENDIAN, encode_header(stamp_ns, frame), shape, layout.encoded, steps, data, b"\1"))


def _decode(payload: bytes, expected: _Layout, said: str) -> tuple[int, str, memoryview]:
    """Stamp, frame, and the data of the points."""
    body = body_of(payload)
    stamp_ns, frame, at = read_header(body)
    height, width, fields = read(_SHAPE, body, at)
    at += _SHAPE.size
    layout = []
    for _ in range(min(fields, len(expected.fields) + 1)):
        name, at = read_text(body, at)
        at = aligned(at, 4)
        layout.append((name, *read(_FIELD, body, at)))
        at += _FIELD.size
    big_endian, point_step, row_step, size = read(_STEPS, body, at)
    at += _STEPS.size
    if (height, layout, big_endian, point_step) != (1, expected.fields, 0, expected.step):
        raise ValueError(f"the points are not laid out as {said}")
    if size != row_step or size != expected.step * width or len(body) != at + size + 1 or body[-1] != 1:
        raise ValueError(f"{width} points declare {size} bytes and hold {len(body) - at - 1}")
    return stamp_ns, frame, body[at:-1]


def _finite(points: NDArray[np.float32]) -> NDArray[np.float32]:
    if not np.isfinite(points).all():
        raise ValueError("the points hold something that is not a number")
    return points
