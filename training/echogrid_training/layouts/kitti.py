"""KITTI: an HDL-64E on the roof of a VW Passat, no radar. Corner radars are played from the lidar (played_radars.py).

Three layouts; each is told by what lies in the folder:

- raw data (the development kit's readme): `velodyne_points/data/*.bin` and `velodyne_points/timestamps.txt`, `oxts/data/*.txt` and
  `oxts/timestamps.txt`. A .bin file is float32 x, y, z, reflectance of each point: x ahead, y left, z up. A stamp is local time,
  "2011-09-26 13:02:25.594360375", one line a turn. An oxts file is one line of 30 numbers; the first are latitude and longitude (degrees),
  altitude (m), roll, pitch and yaw (rad; 0 is east, counter-clockwise). Places come by the kit's Mercator projection.
- odometry benchmark: `velodyne/*.bin`, `times.txt` (s), `calib.txt` whose line `Tr:` is cam0_from_velodyne, and `poses.txt`, which the
  benchmark keeps apart as poses/NN.txt: lines of 12 numbers, rows of the 3 x 4 matrix of the left camera in its first frame. Camera axes:
  x right, y down, z ahead.
- a compact file: xyz_5mm (N, 3), offsets (T + 1,), poses_kissicp (T, 4, 4) of the velodyne in its first frame, at 10 Hz.

By the drawing of the sensor setup the velodyne is 1.73 m above the road, 0.76 m ahead of the rear axle and 0.32 m right of the GPS/IMU,
which is 0.05 m behind the axle; taken as exact to a decimetre. Turns are not freed of the car's motion in the raw layout's _extract drives.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.config.tables import Body
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.labelling.clouds import Cloud, points_of
from echogrid_training.labelling.lidar_mount import LidarMount, base_from_lidar
from echogrid_training.layouts.played_radars import corners, played
from echogrid_training.layouts.with_lidar import Brought, motion_from
from echogrid_training.recording import EPOCH_NS, Recording, Stamps, Track, truth_from, untracked
from echogrid_training.sources import load_npz

BODY = Body(length=4.77, width=1.82, rear_overhang=1.1)  # VW Passat estate
VELODYNE = LidarMount(x=0.76, y=0.0, z=1.73)
BASE_FROM_IMU = SE2(-0.05, 0.32, 0.0)
EARTH = 6378137.0  # m
OXTS = 30  # numbers in a line
PERIOD_NS = 100_000_000  # between two turns of the compact file


@dataclass(frozen=True, slots=True, eq=False)
class Sequence:
    """One drive as its layout has it."""

    name: str
    stamp_ns: Stamps  # (T,) of the turns
    turn: Callable[[int], Floats]  # points (N, 3) m of one in the velodyne's frame
    pose_ns: Stamps  # (P,)
    base: list[SE2]  # (P,) poses of base in any fixed frame


def load(source: Path, track: Track = untracked) -> Brought:
    """Raises EchogridError."""
    sequence = _sequence(source)
    if len(sequence.stamp_ns) < 2 or len(sequence.base) < 2:
        raise EchogridError(f"{source}: has {len(sequence.stamp_ns)} turns and {len(sequence.base)} poses, expected many of both")
    x, y, yaw = np.array([(one.x, one.y, one.yaw) for one in sequence.base]).T
    truth = truth_from(sequence.pose_ns, x, y, yaw)
    turns = [Cloud(int(sequence.stamp_ns[index]), sequence.turn(index)) for index in track(range(len(sequence.stamp_ns)), "reading turns")]
    pose = base_from_lidar(VELODYNE)
    recording = Recording(
        vehicle=re.sub("[^A-Za-z0-9_-]", "_", f"kitti-{sequence.name}-played-radars"),
        body=BODY,
        radars=corners(BODY),
        scans=played(track(turns, "playing radars"), pose, truth, BODY),
        motion=motion_from(truth),
        truth=truth,
    )
    return Brought(recording, turns, pose)


def _sequence(source: Path) -> Sequence:
    if not source.exists():
        raise EchogridError(f"{source}: does not exist, expected a folder of KITTI's raw data or odometry benchmark, or a compact .npz")
    if source.is_file():
        return _compact(source)
    if (source / "velodyne_points").is_dir():
        return _raw(source)
    if (source / "velodyne").is_dir():
        return _odometry(source)
    raise EchogridError(f"{source}: holds neither velodyne_points (raw data) nor velodyne (odometry benchmark)")


def _raw(source: Path) -> Sequence:
    files = sorted((source / "velodyne_points" / "data").glob("*.bin"))
    stamps = _stamps(source / "velodyne_points" / "timestamps.txt")
    by_number = {int(path.stem): path for path in files if path.stem.isdecimal()}  # some turns of some drives are missing
    numbers = [number for number in sorted(by_number) if number < len(stamps)]
    if len(numbers) != len(files) or not files:
        raise EchogridError(
            f"{source}: {len(files)} turns in velodyne_points/data do not go with {len(stamps)} lines of its timestamps.txt"
        )
    pose_ns, rows = _stamps(source / "oxts" / "timestamps.txt"), []
    for path in sorted((source / "oxts" / "data").glob("*.txt")):
        row = _numbers(path)
        if row.shape != (1, OXTS):
            raise EchogridError(f"{path}: holds {row.size} numbers in {len(row)} lines, expected {OXTS} in one")
        rows.append(row[0])
    if len(rows) != len(pose_ns):
        raise EchogridError(f"{source}: {len(rows)} files in oxts/data do not go with {len(pose_ns)} lines of its timestamps.txt")
    table = np.array(rows).reshape(-1, OXTS)
    scale = np.cos(np.radians(table[:1, 0]))
    x = scale * EARTH * np.radians(table[:, 1])
    y = scale * EARTH * np.log(np.tan(np.radians(90 + table[:, 0]) / 2))
    base = [SE2(*one) @ BASE_FROM_IMU.inverse() for one in np.stack((x, y, table[:, 5]), axis=-1).tolist()]
    return Sequence(source.name, stamps[numbers], lambda index: points_of(by_number[numbers[index]]), pose_ns, base)


def _odometry(source: Path) -> Sequence:
    files = sorted((source / "velodyne").glob("*.bin"))
    seconds, camera_from_velodyne = _numbers(source / "times.txt").reshape(-1), calibration(source / "calib.txt")
    poses = source / "poses.txt"
    if not poses.is_file():
        raise EchogridError(
            f"{poses}: is not there; the benchmark keeps it as poses/{source.name}.txt: copy it, or give another pose of each turn"
        )
    rows = _numbers(poses)
    if rows.shape != (len(files), 12) or len(seconds) != len(files):
        raise EchogridError(
            f"{source}: {len(files)} turns in velodyne, {len(seconds)} lines of times.txt and {len(rows)} of poses.txt "
            f"with {rows.shape[-1]} numbers do not go together, expected as many of each, of 12 numbers"
        )
    stamps = EPOCH_NS + np.round(seconds * 1e9).astype(np.int64)
    cameras = np.concatenate((rows.reshape(-1, 3, 4), np.broadcast_to((0.0, 0.0, 0.0, 1.0), (len(rows), 1, 4))), axis=1)
    matrices = np.linalg.inv(camera_from_velodyne) @ cameras @ camera_from_velodyne  # of the velodyne in its first frame
    return Sequence(source.name, stamps, lambda index: points_of(files[index]), stamps, _bases(matrices))


def _compact(source: Path) -> Sequence:
    arrays = load_npz(source, ("xyz_5mm", "offsets", "poses_kissicp"))
    points, offsets, matrices = arrays["xyz_5mm"], arrays["offsets"], arrays["poses_kissicp"]
    if matrices.shape != (len(offsets) - 1, 4, 4) or offsets[-1] != len(points):
        raise EchogridError(f"{source}: the lengths of xyz_5mm, offsets and poses_kissicp do not fit together")
    stamps = EPOCH_NS + PERIOD_NS * np.arange(len(matrices), dtype=np.int64)
    return Sequence(source.stem, stamps, lambda index: points[offsets[index] : offsets[index + 1]] * 0.005, stamps, _bases(matrices))


def _bases(matrices: Floats) -> list[SE2]:
    """Poses of base of those of the velodyne, (P, 4, 4), whose axes are as base's: seen from above."""
    lidar = SE2(VELODYNE.x, VELODYNE.y, 0.0).inverse()
    return [SE2(float(one[0, 3]), float(one[1, 3]), float(np.arctan2(one[1, 0], one[0, 0]))) @ lidar for one in matrices]


def calibration(path: Path) -> Floats:
    """(4, 4) camera_from_velodyne of the line Tr or Tr_velo_to_cam. Raises EchogridError."""
    for line in _text(path).splitlines():
        name, _, values = line.partition(":")
        if name in ("Tr", "Tr_velo_to_cam"):
            try:
                return np.concatenate((np.array(values.split(), dtype=float).reshape(3, 4), [(0.0, 0.0, 0.0, 1.0)]))
            except ValueError as error:
                raise EchogridError(f"{path}: expected 12 numbers behind '{name}:': {error}") from error
    raise EchogridError(f"{path}: has no line 'Tr:' that says where the velodyne is")


def _stamps(path: Path) -> Stamps:
    """(N,) ns of lines of local time, taken as UTC; nine digits behind the point."""
    out = []
    for number, line in enumerate(_text(path).split("\n"), 1):
        if not line.strip():
            continue
        whole, _, fraction = line.strip().partition(".")
        try:
            seconds = datetime.datetime.fromisoformat(whole).replace(tzinfo=datetime.UTC).timestamp()
            out.append(int(seconds) * 10**9 + int(fraction.ljust(9, "0")[:9]))
        except ValueError as error:
            raise EchogridError(f"{path}: line {number}: '{line.strip()}' is no time such as 2011-09-26 13:02:25.594360375") from error
    return np.array(out, np.int64)


def _numbers(path: Path) -> Floats:
    try:
        table = np.array([line.split() for line in _text(path).splitlines() if line.strip()], dtype=float)
    except ValueError as error:
        raise EchogridError(f"{path}: expected lines of numbers, as many in each: {error}") from error
    return table if table.ndim == 2 else table.reshape(0, 0)


def _text(path: Path) -> str:
    try:
        return path.read_text("ascii")
    except OSError as error:
        raise EchogridError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise EchogridError(f"{path}: is not a text file (byte {error.start} is not ASCII)") from error
