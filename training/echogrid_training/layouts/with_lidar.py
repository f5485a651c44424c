"""A data set's drive as a folder that `label` takes: radars and motion as CAN frames, the lidar's turns, its place, and poses of base.

Of a data set without a CAN bus, wheel speeds and yaw rate are made from its poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid_training.drives.drive import TRUTH, write_drive
from echogrid_training.drives.frames import Report
from echogrid_training.labelling.bring import LIDAR, MOUNT, write_turns
from echogrid_training.labelling.clouds import Cloud
from echogrid_training.labelling.lidar_mount import Pose3
from echogrid_training.labelling.odometry import POSES, Poses, write_poses
from echogrid_training.recording import Motion, Recording, Stamps, Track, Truth, untracked

RATE = 50.0  # of wheel speeds and yaw rate that are made from poses, 1/s
TRACK_WIDTH = 1.55  # m between the wheels, for their speeds in turns


@dataclass(frozen=True, slots=True, eq=False)
class Brought:
    """What was read of a data set; the recording's truth are the poses."""

    recording: Recording
    turns: Iterable[Cloud]
    base_from_lidar: Pose3
    latency_ms: float = 0.0  # of the turns' stamps after their middle


def write(brought: Brought, folder: Path, *, fd: bool = True, force: bool = False, track: Track = untracked) -> Report:
    """Writes the drive folder completely or not at all; the true map comes from `label`. Raises EchogridError."""
    truth = brought.recording.truth
    turns = list(brought.turns)

    def beside(partial: Path) -> None:
        (partial / TRUTH).unlink()
        (partial / MOUNT).write_text(mount_text(brought.base_from_lidar, brought.latency_ms), encoding="utf-8")
        write_turns(partial / LIDAR, turns)
        write_poses(partial / POSES, Poses(truth.stamp_ns, truth.x, truth.y, truth.yaw))

    return write_drive(brought.recording, folder, fd=fd, force=force, track=track, beside=beside)


def mount_text(pose: Pose3, latency_ms: float = 0.0) -> str:
    """lidar.toml: `lidar_mount.base_from_lidar` the other way round."""
    turn = pose.rotation
    yaw, pitch, roll = math.atan2(turn[1, 0], turn[0, 0]), math.asin(-np.clip(turn[2, 0], -1, 1)), math.atan2(turn[2, 1], turn[2, 2])
    lines = [f"{name} = {value:.4f}" for name, value in zip("xyz", pose.place, strict=True)]
    lines += [f"{name}_deg = {math.degrees(value):.4f}" for name, value in (("yaw", yaw), ("pitch", pitch), ("roll", roll))]
    return "\n".join([*lines, f"latency_ms = {latency_ms:g}"]) + "\n"


def motion_from(poses: Truth) -> Motion:
    """What wheels and a gyro would have shown along poses: without their errors."""
    time = (poses.stamp_ns - poses.stamp_ns[0]) * 1e-9
    at = np.arange(time[0], time[-1], 1.0 / RATE)
    speed, turning = along(poses, at)
    aside = turning[:, None] * (TRACK_WIDTH / 2) * np.array((-1.0, 1.0, -1.0, 1.0))
    stamps: Stamps = poses.stamp_ns[0] + np.round(at * 1e9).astype(np.int64)
    return Motion(stamps, speed[:, None] + aside, stamps, turning)


def along(poses: Truth, at: Floats) -> tuple[Floats, Floats]:
    """Speed (m/s) and yaw rate (rad/s) of base at times (N,), s since the first pose: of the middle of the steps between poses."""
    time = (poses.stamp_ns - poses.stamp_ns[0]) * 1e-9
    step, middle = np.diff(time), (time[1:] + time[:-1]) / 2
    heading = (poses.yaw[1:] + poses.yaw[:-1]) / 2
    ahead = np.diff(poses.x) * np.cos(heading) + np.diff(poses.y) * np.sin(heading)
    speed: Floats = np.interp(at, middle, ahead / step)
    turning: Floats = np.interp(at, middle, np.diff(poses.yaw) / step)
    return speed, turning
