"""View of Delft: a 64-beam Velodyne on the roof of a Toyota Prius, and one 3+1D radar (ZF FRGen21) behind its front bumper.

One radar that looks ahead: most of what a map of corner radars shows is never looked at, and stays unknown.

The official layout, by the data set's documentation (docs/SENSORS_AND_DATA.md, docs/GETTING_STARTED.md) and its example set:

- `lidar/training/velodyne/NNNNN.bin`: float32 x, y, z, reflectance; x ahead, y left, z up; freed of the car's motion.
- `radar/training/velodyne/NNNNN.bin`: float32 x, y, z, RCS, v_r, v_r_compensated, time, in the radar's frame with the same axes; v_r is the
  range rate against the moving radar, negative where a thing comes nearer; time is 0 for points of this scan. The folders radar_3_scans and
  radar_5_scans hold earlier scans too and are not read.
- `lidar/training/calib/NNNNN.txt` and `radar/training/calib/NNNNN.txt`: in the line `Tr_velo_to_cam:` 12 numbers, rows of the 3 x 4 matrix
  camera_from_lidar and camera_from_radar. Camera axes: x right, y down, z ahead.
- `radar/training/pose/NNNNN.json` (or under lidar): a line with {"odomToCamera": 16 numbers}, rows of the 4 x 4 pose of the camera in a
  frame that begins anew in each sequence, z up from the road.

Frames carry no time: the lidar leads at 10 Hz, so a frame's number is taken for it. The folder holds many sequences, one after the other,
hence --frames. Where the rear axle is nobody says: the radar is taken to be 3.55 m ahead of it, which is right to a decimetre or two.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from echogrid.config.tables import Body
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.labelling.clouds import Cloud, points_of
from echogrid_training.labelling.lidar_mount import Pose3
from echogrid_training.layouts.kitti import calibration
from echogrid_training.layouts.with_lidar import Brought, along, motion_from
from echogrid_training.recording import EPOCH_NS, RadarMount, Recording, Track, truth_from, untracked

BODY = Body(length=4.48, width=1.745, rear_overhang=0.85)  # Toyota Prius of 2013
RADAR_AHEAD = 3.55  # m of the rear axle
FOV = math.radians(120.0)
FIELDS = 7  # of a radar's point
PERIOD_NS = 100_000_000
DRIVING, WRONG_SIGN = 2.0, 0.8  # m/s from which the sign of v_r shows, and the share of detections ahead that may go away


def load(root: Path, frames: tuple[int, int], track: Track = untracked) -> Brought:
    """The frames from the first number to the last, both with it. Raises EchogridError."""
    first, last = frames
    lidar, radar = (root / kind / "training" for kind in ("lidar", "radar"))
    for folder in (lidar / "velodyne", radar / "velodyne"):
        if not folder.is_dir():
            raise EchogridError(f"{folder}: there is no such folder; expected View of Delft's official layout, with lidar and radar")
    numbers = [number for number in range(first, last + 1) if (lidar / "velodyne" / f"{number:05d}.bin").is_file()]
    if len(numbers) < 2:
        raise EchogridError(f"{lidar / 'velodyne'}: has {len(numbers)} turns of the frames {first:05d} to {last:05d}, expected many")
    cameras = [_camera(_existing(number, radar / "pose", lidar / "pose", ending="json")) for number in numbers]
    camera_from_lidar, camera_from_radar = (calibration(_existing(numbers[0], one / "calib", ending="txt")) for one in (lidar, radar))
    base_from_camera = _base_from_camera(cameras[0], camera_from_radar)
    bases = [camera @ np.linalg.inv(base_from_camera) for camera in cameras]
    stamps = EPOCH_NS + PERIOD_NS * np.array(numbers, np.int64)
    x, y, yaw = np.array([(one[0, 3], one[1, 3], _yaw(one)) for one in bases]).T
    truth = truth_from(stamps, x, y, yaw)
    base_from_lidar, base_from_radar = base_from_camera @ camera_from_lidar, base_from_camera @ camera_from_radar
    turns = [
        Cloud(int(stamp), points_of(lidar / "velodyne" / f"{number:05d}.bin"))
        for number, stamp in zip(track(numbers, "reading turns"), stamps, strict=True)
    ]
    scans = [_scan(radar / "velodyne" / f"{number:05d}.bin", int(stamp)) for number, stamp in zip(numbers, stamps, strict=True)]
    speed, _ = along(truth, (stamps - stamps[0]) * 1e-9)
    _check_sign(radar, scans, speed)
    mount = SE2(float(base_from_radar[0, 3]), float(base_from_radar[1, 3]), _yaw(base_from_radar))
    recording = Recording(
        vehicle=f"vod-{first:05d}-{last:05d}",
        body=BODY,
        radars=(RadarMount("front", mount, FOV),),
        scans=scans,
        motion=motion_from(truth),
        truth=truth,
    )
    return Brought(recording, turns, Pose3(base_from_lidar[:3, :3], base_from_lidar[:3, 3]))


def _yaw(pose: Floats) -> float:
    """Of the x axis seen from above."""
    return math.atan2(pose[1, 0], pose[0, 0])


def _existing(number: int, *folders: Path, ending: str) -> Path:
    paths = [folder / f"{number:05d}.{ending}" for folder in folders]
    found = next((path for path in paths if path.is_file()), None)
    if found is None:
        raise EchogridError(f"{paths[0]}: there is no such file")
    return found


def _camera(path: Path) -> Floats:
    """(4, 4) odom_from_camera. Raises EchogridError."""
    try:
        lines = [json.loads(line) for line in path.read_text("ascii").splitlines() if line.strip()]
        matrix = np.array(next(one["odomToCamera"] for one in lines if "odomToCamera" in one), dtype=float).reshape(4, 4)
        if not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-3):
            raise ValueError("its first three columns are no rotation")
    except StopIteration:
        raise EchogridError(f"{path}: no line has the key 'odomToCamera'") from None
    except (ValueError, TypeError, UnicodeDecodeError) as error:
        raise EchogridError(f"{path}: is not a pose of 16 numbers under 'odomToCamera': {error}") from error
    return matrix


def _base_from_camera(odom_from_camera: Floats, camera_from_radar: Floats) -> Floats:
    """(4, 4): base looks where the camera looks, seen from above, and the radar is RADAR_AHEAD of it, in its middle."""
    ahead = math.atan2(odom_from_camera[1, 2], odom_from_camera[0, 2])
    level = np.eye(4)
    level[:2, :2] = ((math.cos(ahead), math.sin(ahead)), (-math.sin(ahead), math.cos(ahead)))
    out: Floats = level @ odom_from_camera
    radar = (out @ camera_from_radar)[:3, 3]
    out[:2, 3] += (RADAR_AHEAD - radar[0], -radar[1])
    return out


def _scan(path: Path, stamp_ns: int) -> RadarScan:
    try:
        raw = np.fromfile(path, dtype="<f4")
    except FileNotFoundError:
        raise EchogridError(f"{path}: there is no such file") from None
    if len(raw) % FIELDS:
        raise EchogridError(f"{path}: holds {len(raw)} numbers, expected {FIELDS} for each point: x, y, z, RCS, v_r, v_r_compensated, time")
    points = raw.reshape(-1, FIELDS).astype(float)
    if (points[:, 6] != 0).any():
        raise EchogridError(f"{path}: has points of earlier scans, expected those of single scans, of the folder radar")
    x, y, _, rcs, rate = points.T[:5]
    return RadarScan("front", stamp_ns, stamp_ns, np.hypot(x, y), np.arctan2(y, x), rate, rcs)


def _check_sign(folder: Path, scans: Sequence[RadarScan], speed: Floats) -> None:
    """Raises EchogridError where most of what lies ahead of a car that drives on goes away from it."""
    rates = np.concatenate(
        [scan.range_rate[np.abs(scan.azimuth) < 0.3] for scan, one in zip(scans, speed, strict=True) if one > DRIVING] or [np.empty(0)]
    )
    if len(rates) and (rates > 0).mean() > WRONG_SIGN:
        raise EchogridError(
            f"{folder}: {(rates > 0).mean():.0%} of what lies ahead goes away while the car drives on: v_r has the other sign"
        )
