"""RadarScenes sequences as recordings: four side and front-corner radars and the car's odometry.

The source is an official folder sequence_N (radar_data.h5, with sensors.json in it or beside the sequences), or a compact file seq_N.npz
that holds the same numbers.

- Radars: azimuth counter-clockwise from boresight and range rate negative when approaching, as in echogrid; the range rate is the raw one.
  Every detection is taken, moving ones too.
- Mounts are in the frame of the rear axle, x forward, y left: radars 1 and 2 sit on the right (y and yaw negative), 3 and 4 on the left.
- The set has no wheel speeds: all four wheels show the odometry's vx, and the gyro its yaw_rate (slope against the derivative of
  yaw: 1.00), both interpolated to 100 Hz.
- The set does not say which car it is: the body is one that the mounts fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from echogrid.config.tables import Body
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.recording import EPOCH_NS, Motion, RadarMount, Recording, truth_from
from echogrid_training.sources import field, load_json, load_npz, some

SENSORS = (1, 2, 3, 4)
BODY = Body(length=4.9, width=1.9, rear_overhang=1.0)
FOV = math.radians(140.0)  # detections reach to ±70°
STEP_US = 10_000  # of the motion frames
DETECTION = ("timestamp", "sensor_id", "range_sc", "azimuth_sc", "vr", "rcs")
ODOMETRY = ("timestamp", "x_seq", "y_seq", "yaw_seq", "vx", "yaw_rate")


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One sequence's numbers as RadarScenes has them, whichever layout they came from. Times in µs on any one clock."""

    name: str
    scans: list[tuple[int, int, Floats]]  # (sensor, µs, (N, 4) range, azimuth, range rate, RCS)
    mounts: dict[int, SE2]
    odometry_us: NDArray[np.int64]  # (N,), strictly increasing
    odometry: Floats  # (N, 5) x, y, yaw, vx, yaw rate


def load(source: Path) -> Recording:
    """The recording of one sequence, from a compact file or an official sequence folder. Raises EchogridError."""
    if not source.exists():
        raise EchogridError(f"{source}: does not exist, expected a RadarScenes folder sequence_N or a seq_N.npz file")
    return recording(read_compact(source) if source.is_file() else read_official(source))


def read_compact(path: Path) -> Source:
    """One seq_N.npz. Raises EchogridError."""
    parts = [f"radar{sensor}_{part}" for sensor in SENSORS for part in ("det", "off", "odom")]
    arrays = load_npz(path, [*parts, "mount_x_y_yaw"])
    scans = []
    for sensor in SENSORS:
        detections, offsets, odometry = (arrays[f"radar{sensor}_{part}"] for part in ("det", "off", "odom"))
        if detections.shape[1:] != (10,) or odometry.shape[1:] != (7,):
            raise EchogridError(
                f"{path}: radar{sensor}_det and radar{sensor}_odom have the shapes {detections.shape} and {odometry.shape}, "
                "expected 10 and 7 columns"
            )
        if len(offsets) != len(odometry) + 1 or offsets[-1] != len(detections):
            raise EchogridError(f"{path}: the lengths of radar{sensor}_det, radar{sensor}_off and radar{sensor}_odom do not fit together")
        split = np.split(detections[:, :4].astype(np.float64), offsets[1:-1])
        scans += [(sensor, round(1e6 * second), part) for second, part in zip(odometry[:, 0].tolist(), split, strict=True)]
    every = np.concatenate([arrays[f"radar{sensor}_odom"] for sensor in SENSORS])
    places = arrays["mount_x_y_yaw"]
    if places.shape != (4, 3):
        raise EchogridError(f"{path}: mount_x_y_yaw has the shape {places.shape}, expected (4, 3)")
    mounts = {sensor: SE2(*(float(value) for value in places[sensor - 1])) for sensor in SENSORS}
    return _source(path.stem, scans, mounts, np.round(1e6 * every[:, 1]).astype(np.int64), every[:, 2:7])


def read_official(folder: Path) -> Source:
    """One sequence_N folder. Raises EchogridError."""
    path = folder / "radar_data.h5"
    radar, odometry = _h5_tables(path)
    order = np.lexsort((radar["sensor_id"], radar["timestamp"]))  # stable: a scan's detections keep their order
    radar = radar[order]
    starts = np.flatnonzero((np.diff(radar["timestamp"]) != 0) | (np.diff(radar["sensor_id"]) != 0)) + 1
    scans = []
    for part in np.split(radar, starts):
        values = np.stack([part[name].astype(np.float64) for name in DETECTION[2:]], axis=-1)
        scans.append((int(part["sensor_id"][0]), int(part["timestamp"][0]), values))
    values = np.stack([odometry[name].astype(np.float64) for name in ODOMETRY[1:]], axis=-1)
    return _source(folder.name, scans, _mounts(folder), odometry["timestamp"].astype(np.int64), values)


def _h5_tables(path: Path) -> tuple[NDArray[np.void], NDArray[np.void]]:
    """The data sets `radar_data` and `odometry`, with the fields that are needed and at least one row."""
    if not path.is_file():
        raise EchogridError(f"{path}: does not exist, expected the radar data of a RadarScenes sequence")
    try:
        with h5py.File(path, "r") as file:
            tables = {name: file[name][()] for name in ("radar_data", "odometry") if isinstance(file.get(name), h5py.Dataset)}
    except OSError as error:
        raise EchogridError(f"{path}: is not an HDF5 file that can be read: {error}") from error
    for name, wanted in (("radar_data", DETECTION), ("odometry", ODOMETRY)):
        if name not in tables or not len(tables[name]):
            raise EchogridError(f"{path}: has no rows in '{name}', found {some(tables)}")
        found = tables[name].dtype.names or ()
        missing = [one for one in wanted if one not in found]
        if missing:
            raise EchogridError(f"{path}: '{name}' has no field '{missing[0]}', found {some(found)}")
    return tables["radar_data"], tables["odometry"]


def _mounts(folder: Path) -> dict[int, SE2]:
    places = [folder / "sensors.json", folder.resolve().parent / "sensors.json"]
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        raise EchogridError(f"{places[0]}: does not exist, nor does {places[1]}; expected the radars' mounts in one of them")
    content = load_json(path)
    mounts = {}
    for sensor in SENSORS:
        place = field(content, f"radar_{sensor}", path)
        try:
            mounts[sensor] = SE2(*(float(field(place, key, path)) for key in ("x", "y", "yaw")))
        except (TypeError, ValueError) as error:
            raise EchogridError(f"{path}: radar_{sensor} needs numbers for x, y and yaw: {error}") from error
    return mounts


def _source(
    name: str, scans: list[tuple[int, int, Floats]], mounts: dict[int, SE2], odometry_us: NDArray[np.int64], odometry: Floats
) -> Source:
    """With each odometry time once."""
    times, first = np.unique(odometry_us, return_index=True)
    return Source(name, scans, mounts, times, odometry[first])


def recording(source: Source) -> Recording:
    """The sequence in echogrid's units and frames; its first radar scan is measured at EPOCH_NS."""
    if not source.scans or len(source.odometry) < 2:
        raise EchogridError(f"{source.name}: has {len(source.scans)} scans and {len(source.odometry)} rows of odometry, expected many")
    names = {sensor: radar_name(mount) for sensor, mount in source.mounts.items()}
    start_us = min(stamp_us for _, stamp_us, _ in source.scans)
    scans = []
    for sensor, stamp_us, values in sorted(source.scans, key=lambda scan: scan[:2]):
        stamp_ns = EPOCH_NS + 1000 * (stamp_us - start_us)
        distance, azimuth, range_rate, rcs = values.T
        scans.append(RadarScan(names[sensor], stamp_ns, stamp_ns, distance, azimuth, range_rate, rcs))
    times_us = np.arange(source.odometry_us[0], source.odometry_us[-1] + 1, STEP_US)
    speed = np.interp(times_us, source.odometry_us, source.odometry[:, 3])
    yaw_rate = np.interp(times_us, source.odometry_us, source.odometry[:, 4])
    motion_ns = EPOCH_NS + 1000 * (times_us - start_us)
    truth_ns = EPOCH_NS + 1000 * (source.odometry_us - start_us)
    x, y, yaw = source.odometry[:, :3].T
    return Recording(
        vehicle=f"radarscenes-{source.name}",
        body=BODY,
        radars=tuple(RadarMount(names[sensor], mount, FOV) for sensor, mount in source.mounts.items()),
        scans=scans,
        motion=Motion(motion_ns, np.repeat(speed[:, None], 4, axis=1), motion_ns, yaw_rate),
        truth=truth_from(truth_ns, x, y, yaw),
    )


def radar_name(base_from_sensor: SE2) -> str:
    """front_left, front_right, left or right: left is where y is positive, front what looks less than 55° aside."""
    side = "left" if base_from_sensor.y > 0 else "right"
    return f"front_{side}" if abs(base_from_sensor.yaw) < math.radians(55.0) else side
