"""ROS 2's CDR (XCDR1, plain, little endian) for the messages we publish, and back.

Encoders raise ValueError where a stamp or a name has no place in the message. Decoders take bytes from anywhere: they raise
ValueError with one sentence, nothing else, and allocate nothing larger than the payload.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.core.motion.se2 import SE2

LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # alignment counts from the byte behind it
SECOND = 10**9  # ns
GID_SIZE = 16

_STAMP = struct.Struct("<iI")  # builtin_interfaces/Time: until 2038
_LENGTH = struct.Struct("<I")
_MAP_META_DATA = struct.Struct("<iIfII")  # map_load_time, resolution, width, height
_ORIGIN = struct.Struct("<7dI")  # position, orientation (x, y, z, w), length of data
_MOTION = struct.Struct("<85d")  # position, orientation, covariance, linear and angular velocity, covariance
_LEVEL = struct.Struct("<B")
_PATCH = struct.Struct("<iiIII")  # x, y, width, height, length of data
_PLACE = struct.Struct("<7d")  # translation, rotation (x, y, z, w)
_SHAPE = struct.Struct("<III")  # height, width, number of fields
_FIELD = struct.Struct("<IBxxxI")  # offset, datatype, count
_STEPS = struct.Struct("<BxxxIII")  # is_bigendian, point_step, row_step, length of data
_FLOAT32 = 7  # sensor_msgs/PointField's number for it
_ATTACHMENT = struct.Struct("<qqB")
_VERSION = struct.Struct("<Iq")

Covariance = NDArray[np.float64]


def _unknown() -> Covariance:
    return np.zeros((6, 6))


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """nav_msgs/OccupancyGrid, axis-parallel: cell [i, j] covers x from origin[0] + j * cell and y from origin[1] + i * cell on."""

    stamp_ns: int  # when it was measured
    frame: str
    cell: float  # m; float32 on the wire
    origin: tuple[float, float]  # m: x and y of the outer corner of cell [0, 0]
    occupancy: NDArray[np.int8]  # (H, W) percent, -1 where never seen; rows along y, columns along x

    @property
    def probability(self) -> NDArray[np.float32]:
        """p(occupied), (H, W) in [0, 1], NaN where never seen."""
        return np.where(self.occupancy < 0, np.float32(np.nan), self.occupancy / np.float32(100))


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """nav_msgs/Odometry of a car on a plane. Covariances are ROS's: x, y, z, roll, pitch, yaw; all zero where nobody estimated them."""

    stamp_ns: int
    frame: str
    child_frame: str
    pose: SE2  # of child_frame in frame
    speed: float  # m/s, along child_frame's x
    yaw_rate: float  # rad/s
    pose_covariance: Covariance = field(default_factory=_unknown)  # (6, 6)
    twist_covariance: Covariance = field(default_factory=_unknown)  # (6, 6)


@dataclass(frozen=True, slots=True, eq=False)
class GridUpdate:
    """map_msgs/OccupancyGridUpdate: cells [i, j] take the places [y + i, x + j] of a grid."""

    stamp_ns: int
    frame: str
    x: int  # column of the first cell in the grid
    y: int  # row
    occupancy: NDArray[np.int8]  # (H, W) percent, -1 where never seen; (0, 0) where nothing changes


@dataclass(frozen=True, slots=True)
class Transform:
    """geometry_msgs/TransformStamped on a plane: `pose` of child_frame in frame."""

    stamp_ns: int
    frame: str
    child_frame: str
    pose: SE2


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """sensor_msgs/PointCloud2 of x, y and z alone, unordered."""

    stamp_ns: int
    frame: str
    points: NDArray[np.float32]  # (N, 3) m, x, y, z in frame


class Level(IntEnum):
    """How a part fares, as diagnostic_msgs/DiagnosticStatus numbers it."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class DiagnosticStatus:
    """diagnostic_msgs/DiagnosticStatus: one part of a machine."""

    level: Level
    name: str  # "program: part"
    message: str
    hardware_id: str
    values: Mapping[str, str]  # in their order; of a key that came twice the last


@dataclass(frozen=True, slots=True)
class DiagnosticArray:
    """diagnostic_msgs/DiagnosticArray: how all parts fare at one time."""

    stamp_ns: int
    frame: str
    status: tuple[DiagnosticStatus, ...]


def encode_grid(grid: Grid) -> bytes:
    """The grid as nav_msgs/msg/OccupancyGrid; map_load_time is 0."""
    height, width = grid.occupancy.shape
    head = _header(grid.stamp_ns, grid.frame) + _MAP_META_DATA.pack(0, 0, grid.cell, width, height)
    origin = _ORIGIN.pack(*grid.origin, 0.0, 0.0, 0.0, 0.0, 1.0, height * width)
    return b"".join((LITTLE_ENDIAN, _padded(head, 8), origin, grid.occupancy.astype(np.int8, copy=False).tobytes()))


def decode_grid(payload: bytes) -> Grid:
    """The grid of a nav_msgs/msg/OccupancyGrid; its `occupancy` is a read-only view of the payload."""
    body = _body(payload)
    stamp_ns, frame, at = _read_header(body)
    _, _, cell, width, height = _read(_MAP_META_DATA, body, at)
    at = _aligned(at + _MAP_META_DATA.size, 8)
    x, y, *rest, count = _read(_ORIGIN, body, at)
    at += _ORIGIN.size
    if count != len(body) - at or count != width * height:
        raise ValueError(f"a grid of {height} x {width} cells says it has {count} and brings {len(body) - at}")
    if not (math.isfinite(cell) and cell > 0 and math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"a grid with cells of {cell} m at ({x}, {y}) is nowhere")
    if rest != [0.0, 0.0, 0.0, 0.0, 1.0]:
        raise ValueError("the grid is lifted or turned, expected it in its frame's plane and parallel to its axes")
    return Grid(stamp_ns, frame, cell, (x, y), _cells(body[at:], height, width))


def encode_update(update: GridUpdate) -> bytes:
    """The update as map_msgs/msg/OccupancyGridUpdate."""
    height, width = update.occupancy.shape
    patch = _PATCH.pack(update.x, update.y, width, height, height * width)
    return b"".join((LITTLE_ENDIAN, _header(update.stamp_ns, update.frame), patch, update.occupancy.astype(np.int8, copy=False).tobytes()))


def decode_update(payload: bytes) -> GridUpdate:
    """The update of a map_msgs/msg/OccupancyGridUpdate; its `occupancy` is a read-only view of the payload."""
    body = _body(payload)
    stamp_ns, frame, at = _read_header(body)
    x, y, width, height, count = _read(_PATCH, body, at)
    at += _PATCH.size
    if count != len(body) - at or count != width * height:
        raise ValueError(f"an update of {height} x {width} cells says it has {count} and brings {len(body) - at}")
    if x < 0 or y < 0:
        raise ValueError(f"an update of the cells from row {y} and column {x} on lies outside its grid")
    return GridUpdate(stamp_ns, frame, x, y, _cells(body[at:], height, width))


def encode_odometry(odometry: Odometry) -> bytes:
    """The odometry as nav_msgs/msg/Odometry: z, roll, pitch and their rates are 0."""
    head = _header(odometry.stamp_ns, odometry.frame) + _text(odometry.child_frame)
    pose, half = odometry.pose, odometry.pose.yaw / 2
    motion = _MOTION.pack(
        *(pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half)),
        *odometry.pose_covariance.ravel(),
        *(odometry.speed, 0.0, 0.0, 0.0, 0.0, odometry.yaw_rate),
        *odometry.twist_covariance.ravel(),
    )
    return b"".join((LITTLE_ENDIAN, _padded(head, 8), motion))


def decode_odometry(payload: bytes) -> Odometry:
    """The odometry of a nav_msgs/msg/Odometry, yaw within (-pi, pi]; what leaves the plane is refused, sideways speed is not read."""
    body = _body(payload)
    stamp_ns, frame, at = _read_header(body)
    child_frame, at = _read_text(body, at)
    at = _aligned(at, 8)
    numbers = np.array(_read(_MOTION, body, at))
    if len(body) != at + _MOTION.size:
        raise ValueError(f"{len(body) - at - _MOTION.size} bytes are left over behind the odometry")
    if not np.isfinite(numbers).all():
        raise ValueError("the odometry holds something that is no number")
    x, y, _, *turn = numbers[:7].tolist()
    pose = _pose_of(x, y, *turn)
    pose_covariance, twist_covariance = numbers[7:43].reshape(6, 6), numbers[49:].reshape(6, 6)
    speed, yaw_rate = float(numbers[43]), float(numbers[48])
    return Odometry(stamp_ns, frame, child_frame, pose, speed, yaw_rate, pose_covariance, twist_covariance)


def encode_transforms(transforms: Sequence[Transform]) -> bytes:
    """The transforms as tf2_msgs/msg/TFMessage: z, roll and pitch are 0."""
    body = _LENGTH.pack(len(transforms))
    for transform in transforms:
        pose, half = transform.pose, transform.pose.yaw / 2
        body = _padded(body, 4) + _header(transform.stamp_ns, transform.frame) + _text(transform.child_frame)
        body = _padded(body, 8) + _PLACE.pack(pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))
    return LITTLE_ENDIAN + body


def decode_transforms(payload: bytes) -> tuple[Transform, ...]:
    """The transforms of a tf2_msgs/msg/TFMessage, yaw within (-pi, pi]; what leaves the plane is refused."""
    body = _body(payload)
    (count,) = _read(_LENGTH, body, 0)
    at, transforms = _LENGTH.size, []
    for _ in range(count):  # however many there should be, the payload's end ends it
        stamp_ns, frame, at = _read_header(body, _aligned(at, 4))
        child_frame, at = _read_text(body, at)
        at = _aligned(at, 8)
        place = _read(_PLACE, body, at)
        at += _PLACE.size
        if place[2] != 0:
            raise ValueError("the transform leaves the plane")
        transforms.append(Transform(stamp_ns, frame, child_frame, _pose_of(*place[:2], *place[3:])))
    if at != len(body):
        raise ValueError(f"{len(body) - at} bytes are left over behind the transforms")
    return tuple(transforms)


def encode_points(points: Points) -> bytes:
    """The points as sensor_msgs/msg/PointCloud2: float32 x, y, z, one behind the other, all finite."""
    count = len(points.points)
    body = _header(points.stamp_ns, points.frame) + _SHAPE.pack(1, count, 3)
    for number, name in enumerate("xyz"):
        body = _padded(body + _text(name), 4) + _FIELD.pack(4 * number, _FLOAT32, 1)
    body += _STEPS.pack(0, 12, 12 * count, 12 * count)
    return b"".join((LITTLE_ENDIAN, body, points.points.astype("<f4", copy=False).tobytes(), b"\1"))


def decode_points(payload: bytes) -> Points:
    """The points of a sensor_msgs/msg/PointCloud2 that is laid out as `encode_points` does; a read-only view of the payload."""
    body = _body(payload)
    stamp_ns, frame, at = _read_header(body)
    height, width, fields = _read(_SHAPE, body, at)
    at += _SHAPE.size
    layout = []
    for _ in range(min(fields, 4)):
        name, at = _read_text(body, at)
        at = _aligned(at, 4)
        layout.append((name, *_read(_FIELD, body, at)))
        at += _FIELD.size
    big_endian, point_step, row_step, size = _read(_STEPS, body, at)
    at += _STEPS.size
    expected = [(name, 4 * number, _FLOAT32, 1) for number, name in enumerate("xyz")]
    if (height, layout, big_endian, point_step) != (1, expected, 0, 12):
        raise ValueError("the points are not laid out as float32 x, y, z, one behind the other")
    if size != row_step or size != 12 * width or len(body) != at + size + 1 or body[-1] != 1:
        raise ValueError(f"{width} points say they have {size} bytes and bring {len(body) - at - 1}")
    points = np.frombuffer(body[at:-1], dtype="<f4").reshape(-1, 3)
    if not np.isfinite(points).all():
        raise ValueError("the points hold something that is no number")
    return Points(stamp_ns, frame, points)


def encode_diagnostics(array: DiagnosticArray) -> bytes:
    """The diagnostics as diagnostic_msgs/msg/DiagnosticArray."""
    body = _header(array.stamp_ns, array.frame) + _LENGTH.pack(len(array.status))
    for status in array.status:
        body = _with_texts(body + _LEVEL.pack(status.level), (status.name, status.message, status.hardware_id))
        body = _padded(body, 4) + _LENGTH.pack(len(status.values))
        body = _with_texts(body, (text for pair in status.values.items() for text in pair))
    return LITTLE_ENDIAN + body


def decode_diagnostics(payload: bytes) -> DiagnosticArray:
    """The diagnostics of a diagnostic_msgs/msg/DiagnosticArray."""
    body = _body(payload)
    stamp_ns, frame, at = _read_header(body)
    (count,) = _read(_LENGTH, body, at)
    at += _LENGTH.size
    status = []
    for _ in range(count):  # however many there should be, the payload's end ends it
        (level,) = _read(_LEVEL, body, at)
        if level > max(Level):
            raise ValueError(f"a diagnostic level of {level}, expected 0 ... {max(Level)}")
        (name, message, hardware_id), at = _read_texts(body, at + _LEVEL.size, 3)
        at = _aligned(at, 4)
        (pairs,) = _read(_LENGTH, body, at)
        texts, at = _read_texts(body, at + _LENGTH.size, 2 * pairs)
        values = dict(zip(texts[::2], texts[1::2], strict=True))
        status.append(DiagnosticStatus(Level(level), name, message, hardware_id, values))
    if at != len(body):
        raise ValueError(f"{len(body) - at} bytes are left over behind the diagnostics")
    return DiagnosticArray(stamp_ns, frame, tuple(status))


def _pose_of(x: float, y: float, roll: float, pitch: float, z: float, w: float) -> SE2:
    """A place and a quaternion as a pose on the plane."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"a pose at ({x}, {y}) is nowhere")
    if roll != 0 or pitch != 0 or not abs(math.hypot(z, w) - 1) <= 1e-6:
        raise ValueError("the orientation is no turn about the z axis")
    return SE2(x, y, math.atan2(2 * w * z, w * w - z * z))


def _cells(data: memoryview, height: int, width: int) -> NDArray[np.int8]:
    occupancy = np.frombuffer(data, dtype=np.int8).reshape(height, width)
    if occupancy.size and (occupancy.min() < -1 or occupancy.max() > 100):
        raise ValueError("the grid has cells outside -1 ... 100 percent")
    return occupancy


def encode_attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """What rmw_zenoh wants beside every sample: its number (from 1), its source's time and the publisher's 16-byte id. 33 bytes."""
    if len(gid) != GID_SIZE:
        raise ValueError(f"a gid of {len(gid)} bytes, expected {GID_SIZE}")
    return _ATTACHMENT.pack(sequence, stamp_ns, GID_SIZE) + gid


def decode_attachment(attachment: bytes) -> tuple[int, int, bytes]:
    """Sequence number, stamp_ns, gid."""
    if len(attachment) != _ATTACHMENT.size + GID_SIZE or attachment[_ATTACHMENT.size - 1] != GID_SIZE:
        raise ValueError(f"an attachment of {len(attachment)} bytes is not rmw_zenoh's")
    sequence, stamp_ns, _ = _ATTACHMENT.unpack_from(attachment)
    return sequence, stamp_ns, attachment[_ATTACHMENT.size :]


def encode_version(epoch: int, keyframe: int) -> bytes:
    """What follows that beside our own grids: which map, and which key frame it is or was made for. 12 bytes."""
    return _VERSION.pack(epoch, keyframe)


def decode_grid_attachment(attachment: bytes) -> tuple[int, int, bytes, int, int]:
    """Sequence number, stamp_ns, gid, epoch, key frame."""
    first = len(attachment) - _VERSION.size
    if first < 0:
        raise ValueError(f"an attachment of {len(attachment)} bytes is not that of a grid")
    return *decode_attachment(attachment[:first]), *_VERSION.unpack_from(attachment, first)


def _header(stamp_ns: int, frame: str) -> bytes:
    """std_msgs/Header, padded to 4 for what follows."""
    seconds, nanoseconds = divmod(stamp_ns, SECOND)
    if not -(2**31) <= seconds < 2**31:
        raise ValueError(f"the stamp {stamp_ns} ns does not fit into ROS's 32-bit seconds")
    return _padded(_STAMP.pack(seconds, nanoseconds) + _text(frame), 4)


def _text(text: str) -> bytes:
    data = text.encode()
    if 0 in data:
        raise ValueError(f"the name {text!r} holds a NUL")
    return _LENGTH.pack(len(data) + 1) + data + b"\0"


def _with_texts(body: bytes, texts: Iterable[str]) -> bytes:
    """The body and behind it each text, from the next multiple of 4 on."""
    for text in texts:
        body = _padded(body, 4) + _text(text)
    return body


def _aligned(at: int, size: int) -> int:
    return at + -at % size


def _padded(data: bytes, size: int) -> bytes:
    return data.ljust(_aligned(len(data), size), b"\0")


def _body(payload: bytes) -> memoryview:
    if payload[:4] != LITTLE_ENDIAN:
        raise ValueError(f"the payload begins with {payload[:4].hex(' ') or 'nothing'}, expected plain little-endian CDR")
    return memoryview(payload)[4:]


def _read(layout: struct.Struct, body: memoryview, at: int) -> tuple[Any, ...]:
    if len(body) < at + layout.size:
        raise ValueError(f"the message ends at byte {len(body)}, expected at least {at + layout.size}")
    return layout.unpack_from(body, at)


def _read_header(body: memoryview, at: int = 0) -> tuple[int, str, int]:
    """Stamp in ns, frame, and where the next 4-byte value begins."""
    seconds, nanoseconds = _read(_STAMP, body, at)
    if nanoseconds >= SECOND:
        raise ValueError(f"the stamp has {nanoseconds} ns beside its seconds")
    frame, at = _read_text(body, at + _STAMP.size)
    return seconds * SECOND + nanoseconds, frame, _aligned(at, 4)


def _read_text(body: memoryview, at: int) -> tuple[str, int]:
    """A name, and where it ends."""
    (length,) = _read(_LENGTH, body, at)
    start, stop = at + _LENGTH.size, at + _LENGTH.size + length
    data = bytes(body[start:stop])
    if len(data) != length or not data.endswith(b"\0") or 0 in data[:-1]:
        raise ValueError(f"a name of {length} bytes does not end with the only NUL in it")
    try:
        return data[:-1].decode(), stop
    except UnicodeDecodeError as error:
        raise ValueError(f"a name is no UTF-8 from its byte {error.start} on") from error


def _read_texts(body: memoryview, at: int, count: int) -> tuple[list[str], int]:
    """So many texts, each from the next multiple of 4 on, and where the last ends."""
    texts = []
    for _ in range(count):
        text, at = _read_text(body, _aligned(at, 4))
        texts.append(text)
    return texts, at
