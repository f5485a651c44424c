"""Odometry and transforms as ROS's messages in CDR (`cdr`), odometry back too; all on a plane."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.motion.se2 import SE2
from echogrid.topics.cdr import LENGTH, LITTLE_ENDIAN, aligned, body_of, encode_header, encode_name, padded, read, read_header, read_text

_MOTION = struct.Struct("<85d")  # position, orientation, covariance, linear and angular velocity, covariance
_TWIST = struct.Struct("<6d")  # linear and angular velocity
_PLACE = struct.Struct("<7d")  # translation, rotation (x, y, z, w)
MOST_ODOMETRY = 4096  # bytes: names of frames are not longer
LONGEST_OFF = 0.01  # of a quaternion's length: senders round
Covariance = NDArray[np.float64]


PLANE, WAY = np.ix_((0, 1, 5), (0, 1, 5)), np.ix_((0, 5), (0, 5))  # of ROS's axes: x, y and yaw; along and about which a car moves


def _unknown() -> Covariance:
    return np.zeros((6, 6))


class Odometry(msgspec.Struct, frozen=True, eq=False):
    """nav_msgs/Odometry of a car on a plane. Covariances are ROS's: x, y, z, roll, pitch, yaw; all zero if they are not estimated."""

    stamp_ns: int
    frame: str
    child_frame: str
    pose: SE2  # of child_frame in frame
    speed: float  # m/s, along child_frame's x
    yaw_rate: float  # rad/s
    pose_covariance: Covariance = msgspec.field(default_factory=_unknown)  # (6, 6)
    twist_covariance: Covariance = msgspec.field(default_factory=_unknown)  # (6, 6)


class Transform(msgspec.Struct, frozen=True):
    """geometry_msgs/TransformStamped on a plane: `pose` of child_frame in frame."""

    stamp_ns: int
    frame: str
    child_frame: str
    pose: SE2


def spread(covariance: Covariance, axes: tuple[NDArray[np.intp], ...]) -> Covariance:
    """(6, 6) of ROS from one of some of its axes, as np.ix_ has them; a car on a plane is sure of the others, whose variances are 0."""
    whole = _unknown()
    whole[axes] = covariance
    return whole


def encode_odometry(odometry: Odometry) -> bytes:
    """The odometry as nav_msgs/msg/Odometry: z, roll, pitch and their rates are 0."""
    head = encode_header(odometry.stamp_ns, odometry.frame) + encode_name(odometry.child_frame)
    twist = _TWIST.pack(odometry.speed, 0.0, 0.0, 0.0, 0.0, odometry.yaw_rate)
    of_pose, of_twist = odometry.pose_covariance.astype("<f8", copy=False), odometry.twist_covariance.astype("<f8", copy=False)
    return b"".join((LITTLE_ENDIAN, padded(head, 8), _place(odometry.pose), of_pose.tobytes(), twist, of_twist.tobytes()))


def decode_odometry(payload: bytes) -> Odometry:
    """The odometry of a nav_msgs/msg/Odometry, yaw within (-pi, pi]; what leaves the plane is refused, sideways speed is not read."""
    body = body_of(payload)
    stamp_ns, frame, at = read_header(body)
    child_frame, at = read_text(body, at)
    at = aligned(at, 8)
    numbers = np.array(read(_MOTION, body, at))
    if len(body) != at + _MOTION.size:
        raise ValueError(f"{len(body) - at - _MOTION.size} bytes are left over after the odometry")
    if not np.isfinite(numbers).all():
        raise ValueError("the odometry holds something that is not a number")
    x, y, _, *turn = numbers[:7].tolist()
    pose = _pose_of(x, y, *turn)
    pose_covariance, twist_covariance = numbers[7:43].reshape(6, 6), numbers[49:].reshape(6, 6)
    speed, yaw_rate = float(numbers[43]), float(numbers[48])
    return Odometry(stamp_ns, frame, child_frame, pose, speed, yaw_rate, pose_covariance, twist_covariance)


def decode_pose(payload: bytes) -> tuple[int, SE2]:
    """Stamp, and the pose on the plane, of any sender's nav_msgs/msg/Odometry: height and twist are not read, of how it leans only the yaw.

    Its covariances may hold anything.
    """
    body = body_of(payload)
    stamp_ns, _, at = read_header(body)
    _, at = read_text(body, at)
    at = aligned(at, 8)
    if len(body) != at + _MOTION.size:
        raise ValueError(f"the odometry has {len(body) - at} bytes of numbers, expected {_MOTION.size}")
    x, y, _, *quaternion = read(_PLACE, body, at)
    i, j, k, w = quaternion
    if not (math.isfinite(x) and math.isfinite(y) and abs(math.hypot(i, j, k, w) - 1) <= LONGEST_OFF):
        raise ValueError("the odometry's pose is none")
    return stamp_ns, SE2(x, y, math.atan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k)))


def encode_transforms(transforms: Sequence[Transform]) -> bytes:
    """The transforms as tf2_msgs/msg/TFMessage: z, roll and pitch are 0."""
    body = LENGTH.pack(len(transforms))
    for transform in transforms:
        body += encode_header(transform.stamp_ns, transform.frame) + encode_name(transform.child_frame)
        body = padded(body, 8) + _place(transform.pose)
    return LITTLE_ENDIAN + body


def _place(pose: SE2) -> bytes:
    """As position or translation, and orientation or rotation."""
    half = pose.yaw / 2
    return _PLACE.pack(pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))


def _pose_of(x: float, y: float, roll: float, pitch: float, z: float, w: float) -> SE2:
    """A place and a quaternion as a pose on the plane."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"a pose at ({x}, {y}) is nowhere")
    if roll != 0 or pitch != 0 or not abs(math.hypot(z, w) - 1) <= 1e-6:
        raise ValueError("the orientation is not a rotation about the z axis")
    return SE2(x, y, math.atan2(2 * w * z, w * w - z * z))
