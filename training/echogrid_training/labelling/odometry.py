"""Poses of base that somebody else knows: nav_msgs/Odometry in an MCAP file or a bag of ROS 2, in place of our dead reckoning.

poses.npz in the drive folder: stamp_ns (N,) int64 rising; x, y (m), yaw (rad, continuous) float64 of base, the first one 0, 0, 0.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.topics.cdr import aligned, body_of, read, read_header, read_text
from echogrid_training.labelling import bag
from echogrid_training.labelling.lidar_mount import OdometryMount
from echogrid_training.recording import Stamps
from echogrid_training.sources import load_npz

POSES = "poses.npz"
ODOMETRY = "nav_msgs/msg/Odometry"
KEYS = ("stamp_ns", "x", "y", "yaw")
FASTEST = 100.0  # m/s: what goes faster has jumped
GAP_NS = 500_000_000  # between two poses, over which none is given
AROUND = 0.1  # s to each side, over which speed and yaw rate are taken
_PLACE = struct.Struct("<7d")  # position, orientation (x, y, z, w)


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Where base was, at rising stamps."""

    stamp_ns: Stamps  # (N,), two at least
    x: Floats  # (N,) m
    y: Floats  # (N,) m
    yaw: Floats  # (N,) rad, continuous

    def at(self, stamps: Stamps) -> list[EgoState | None]:
        """Between two poses at most GAP_NS apart; else None."""
        return [self._one(stamp_ns) for stamp_ns in stamps.tolist()]

    def _one(self, stamp_ns: int) -> EgoState | None:
        after = int(np.searchsorted(self.stamp_ns, stamp_ns, side="left"))
        before = after if after < len(self.stamp_ns) and self.stamp_ns[after] == stamp_ns else after - 1
        if before < 0 or after >= len(self.stamp_ns) or self.stamp_ns[after] - self.stamp_ns[before] > GAP_NS:
            return None
        time = (self.stamp_ns - self.stamp_ns[before]) * 1e-9
        now = (stamp_ns - int(self.stamp_ns[before])) * 1e-9
        around = np.clip((now - AROUND, now, now + AROUND), time[0], time[-1])
        x, y, yaw = (np.interp(around, time, column) for column in (self.x, self.y, self.yaw))
        seconds = float(around[2] - around[0])
        ahead = (x[2] - x[0]) * math.cos(yaw[1]) + (y[2] - y[0]) * math.sin(yaw[1])
        return EgoState(stamp_ns, SE2(float(x[1]), float(y[1]), float(yaw[1])), float(ahead) / seconds, float(yaw[2] - yaw[0]) / seconds)


def read_odometry(source: Path, topic: str | None, mount: OdometryMount) -> Poses:
    """In order of the stamps, of which a repeated one counts once. Raises EchogridError."""
    if not source.exists():
        raise EchogridError(f"{source}: there is no such file or folder with an odometry topic")
    paths = bag.files(source)
    if not paths:
        raise EchogridError(f"{source}: expected an .mcap file or a bag of ROS 2 with {ODOMETRY}")
    rows = list(bag.messages(paths, ODOMETRY, topic, "--odometry-topic", decode_pose))
    latency = round(mount.latency_ms * 1e6)
    stamps, first = np.unique(np.array([row[0] - latency for row in rows], np.int64), return_index=True)
    if len(stamps) < 2:
        raise EchogridError(f"{source}: holds {len(stamps)} poses of {ODOMETRY}, expected many")
    places = [odom_from_child @ mount.base_from_child().inverse() for _, odom_from_child in (rows[index] for index in first)]
    return checked(poses_of(stamps, places), source)


def poses_of(stamps: Stamps, places: Sequence[SE2]) -> Poses:
    """In the frame of the first of them, so that it is (0, 0, 0)."""
    start = places[0].inverse()
    x, y, yaw = np.array([(one.x, one.y, one.yaw) for one in (start @ place for place in places)]).T
    return Poses(stamps, x, y, np.unwrap(yaw))


def checked(poses: Poses, source: Path) -> Poses:
    """Raises EchogridError where it jumps: then it is no odometry, and walls would stand twice."""
    seconds = np.diff(poses.stamp_ns) * 1e-9
    step = np.hypot(np.diff(poses.x), np.diff(poses.y))
    fast = np.flatnonzero(step > np.maximum(FASTEST * seconds, 0.5))
    if len(fast):
        index = int(fast[0])
        raise EchogridError(
            f"{source}: its odometry jumps by {step[index]:.1f} m within {seconds[index]:.2f} s at {int(poses.stamp_ns[index + 1])} ns; "
            "expected one frame that does not jump, as REP 105 has odom"
        )
    return poses


def decode_pose(payload: bytes) -> tuple[int, SE2]:
    """Stamp (ns), and the pose of child_frame_id in the header's frame as seen from above. Raises ValueError."""
    body = body_of(payload)
    stamp_ns, _, at = read_header(body)
    _, at = read_text(body, at)
    x, y, z, qx, qy, qz, qw = read(_PLACE, body, aligned(at, 8))
    size = math.hypot(qx, qy, qz, qw)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and abs(size - 1) < 0.01):
        raise ValueError(f"a pose at ({x:g}, {y:g}) with a quaternion of length {size:g}")
    return stamp_ns, SE2(x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)))


def write_poses(path: Path, poses: Poses) -> None:
    """`poses.npz`."""
    np.savez(path, stamp_ns=poses.stamp_ns, x=poses.x, y=poses.y, yaw=poses.yaw)


def load_poses(path: Path) -> Poses | None:
    """None where the drive has none. Raises EchogridError."""
    if not path.is_file():
        return None
    arrays = load_npz(path, KEYS)
    if arrays["stamp_ns"].ndim != 1 or len(arrays["stamp_ns"]) < 2 or any(arrays[key].shape != arrays["stamp_ns"].shape for key in KEYS):
        raise EchogridError(f"{path}: its arrays {', '.join(KEYS)} differ in length, or hold less than two poses")
    return checked(Poses(*(arrays[key] for key in KEYS)), path)
