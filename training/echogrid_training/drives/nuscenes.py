"""nuScenes scenes as recordings: its four corner radars, wheel speeds, yaw rate and reference poses.

The source is the official layout (tables in v1.0-*/, radar clouds, and the CAN bus expansion in can_bus/) or a compact file
scene-XXXX.npz that holds the same numbers of one scene.

- Radars: Continental ARS408 clusters in the sensor's frame, x along boresight, y left. Every cluster is taken, whatever its quality flags
  say. range = hypot(x, y); azimuth = atan2(y, x), counter-clockwise; range rate = (x vx + y vy)/range from the raw vx, vy, which are
  relative to the moving sensor (vx_comp, vy_comp have the ego motion taken out).
- base is nuScenes' ego frame: rear axle, x forward, y left.
- Wheel speeds are in rpm. Of the tyre's radius only 0.300–0.308 m is known; WHEEL_RADIUS is taken for all scenes, which leaves a wheel
  scale that is wrong by up to 1 %, as on a real car. They have no sign: the car is in reverse where the reference pose's forward speed
  is below REVERSE.
- Yaw rate is the IMU's rotation about z, counter-clockwise positive like the pose's yaw (slope against its derivative: 1.00–1.02).
- The reference pose's yaw points about 0.3° left of the direction of travel on straight roads. It is left as it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.config.tables import Body
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.drives.pcd import load_pcd
from echogrid_training.recording import Motion, RadarMount, Recording, Track, truth_from, untracked
from echogrid_training.sources import field, load_json, load_npz, numbers, some

RADARS = {"FRONT_LEFT": "front_left", "FRONT_RIGHT": "front_right", "BACK_LEFT": "rear_left", "BACK_RIGHT": "rear_right"}
BODY = Body(length=4.084, width=1.73, rear_overhang=0.657)  # Renault Zoe
FOV = math.radians(150.0)  # 99 % of the clusters nearer than 25 m are within ±74°
WHEEL_RADIUS = 0.305  # m
REVERSE = -0.2  # m/s
CLUSTER = ("x", "y", "rcs", "vx", "vy")
WHEELS = ("RL_wheel_speed", "RR_wheel_speed", "FL_wheel_speed", "FR_wheel_speed")  # rpm


@dataclass(frozen=True, slots=True, eq=False)
class Sweeps:
    """One radar's scans: stamps (N,) µs, clusters (n, 5) for each as CLUSTER names them, and (7,) x, y, z, qw, qx, qy, qz in base."""

    stamp_us: NDArray[np.int64]
    clusters: list[Floats]
    mount: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """One scene's numbers as nuScenes has them, whichever layout they came from."""

    name: str
    sweeps: dict[str, Sweeps]  # by RADARS' keys
    wheels: Floats  # (N, 5) µs, then WHEELS
    imu: Floats  # (N, 2) µs, rad/s about z
    pose: Floats  # (N, 8) µs, x, y, qw, qx, qy, qz, forward speed


def load(source: Path, scene: str | None = None, track: Track = untracked) -> Recording:
    """The recording of one scene: from a compact file, a folder of such files, or the official layout's root. Raises EchogridError."""
    if not source.exists():
        raise EchogridError(f"{source}: does not exist, expected a nuScenes folder or a scene-XXXX.npz file")
    if source.is_file():
        if scene is not None and scene != source.stem:
            raise EchogridError(f"{source}: holds {source.stem}, not '{scene}'")
        return recording(read_compact(source))
    if any(source.glob("v1.0-*")):
        return recording(read_official(source, scene, track))
    compact = sorted(source.glob("scene-*.npz"))
    if not compact:
        raise EchogridError(f"{source}: holds neither v1.0-* tables nor scene-*.npz files")
    return recording(read_compact(source / f"{_choose([path.stem for path in compact], scene, source)}.npz"))


def _choose(names: Sequence[str], scene: str | None, source: Path) -> str:
    """The wanted scene, or the only one."""
    if scene is None and len(names) == 1:
        return names[0]
    if scene is None:
        raise EchogridError(f"{source}: holds {len(names)} scenes, say which with --scene: {some(names)}")
    if scene not in names:
        raise EchogridError(f"{source}: has no scene '{scene}', found {some(names)}")
    return scene


def read_compact(path: Path) -> Source:
    """One scene-XXXX.npz. Raises EchogridError."""
    tables = ("can_zoe_veh_info", "can_ms_imu", "can_pose")
    keys = [f"{radar}_{part}" for radar in RADARS for part in ("det", "off", "t_us", "calib_txyz_qwxyz")]
    arrays = load_npz(path, [*keys, "det_fields", *tables, *(f"{table}_fields" for table in tables)])

    def columns(table: str, fields: str, wanted: Sequence[str]) -> Floats:
        names = [str(name) for name in arrays[fields]]
        missing = [name for name in wanted if name not in names]
        if missing:
            raise EchogridError(f"{path}: {fields} has no '{missing[0]}', found {some(names)}")
        if arrays[table].ndim != 2 or arrays[table].shape[1] != len(names):
            raise EchogridError(
                f"{path}: {table} has the shape {arrays[table].shape}, expected {len(names)} columns as {fields} names them"
            )
        return arrays[table][:, [names.index(name) for name in wanted]].astype(np.float64)

    sweeps = {}
    for radar in RADARS:
        clusters, offsets = columns(f"{radar}_det", "det_fields", CLUSTER), arrays[f"{radar}_off"]
        mount = arrays[f"{radar}_calib_txyz_qwxyz"]
        if len(offsets) != len(arrays[f"{radar}_t_us"]) + 1 or offsets[-1] != len(clusters) or mount.shape != (7,):
            raise EchogridError(f"{path}: the lengths of {radar}_off, _t_us, _det and _calib_txyz_qwxyz do not fit together")
        stamps = np.round(arrays[f"{radar}_t_us"]).astype(np.int64)
        sweeps[radar] = Sweeps(stamps, np.split(clusters, offsets[1:-1]), mount)
    pose = ("utime", "px", "py", "orientation_1", "orientation_2", "orientation_3", "orientation_4", "vx")
    return Source(
        path.stem,
        sweeps,
        columns("can_zoe_veh_info", "can_zoe_veh_info_fields", ("utime", *WHEELS)),
        columns("can_ms_imu", "can_ms_imu_fields", ("utime", "rotation_rate_z")),
        columns("can_pose", "can_pose_fields", pose),
    )


def official_scene(root: Path, scene: str | None) -> tuple[str, Path, str]:
    """Name, folder of tables, and token of the wanted scene, or of the only one. Raises EchogridError."""
    scenes = {
        str(field(record, "name", path)): (path.parent, str(field(record, "token", path)))
        for path in sorted(root.glob("v1.0-*/scene.json"))
        for record in _records(path)
    }
    if not scenes:
        raise EchogridError(f"{root}: no v1.0-* folder holds a scene.json with scenes")
    name = _choose(list(scenes), scene, root)
    return name, *scenes[name]


def read_official(root: Path, scene: str | None, track: Track = untracked) -> Source:
    """One scene of the official layout, with the CAN bus expansion. Raises EchogridError."""
    name, tables, token = official_scene(root, scene)
    can_bus = root / "can_bus"
    wheels, imu, pose = (can_bus / f"{name}_{kind}.json" for kind in ("zoe_veh_info", "ms_imu", "pose"))
    orientation = [("orientation", part) for part in range(4)]
    return Source(
        name,
        {
            radar: Sweeps(
                clouds.stamp_us,
                [load_pcd(root / path, CLUSTER) for path in track(clouds.files, f"reading RADAR_{radar}")],
                clouds.mount,
            )
            for radar, clouds in zip(RADARS, clouds_of(tables, token, [f"RADAR_{radar}" for radar in RADARS]), strict=True)
        },
        numbers(load_json(wheels), [("utime", None), *((wheel, None) for wheel in WHEELS)], wheels),
        numbers(load_json(imu), [("utime", None), ("rotation_rate", 2)], imu),
        numbers(load_json(pose), [("utime", None), ("pos", 0), ("pos", 1), *orientation, ("vel", 0)], pose),
    )


def _records(path: Path) -> list[Any]:
    records = load_json(path)
    if not isinstance(records, list):
        raise EchogridError(f"{path}: expected a list of records, found {type(records).__name__}")
    return records


@dataclass(frozen=True, slots=True, eq=False)
class Clouds:
    """The files of one sensor that belong to samples of a scene, keyframes and the sweeps between them: as `Sweeps`."""

    stamp_us: NDArray[np.int64]
    files: list[str]  # below the root
    mount: Floats


def clouds_of(tables: Path, scene_token: str, wanted: Sequence[str]) -> list[Clouds]:
    """Of each of the channels that are wanted. Raises EchogridError where one has none."""
    paths = {table: tables / f"{table}.json" for table in ("sample", "sensor", "calibrated_sensor", "sample_data")}
    records = {table: _records(path) for table, path in paths.items()}

    def of(table: str, record: Any, key: str) -> Any:
        return field(record, key, paths[table])

    samples = {of("sample", one, "token") for one in records["sample"] if of("sample", one, "scene_token") == scene_token}
    channels = {of("sensor", one, "token"): of("sensor", one, "channel") for one in records["sensor"]}
    calibrations = {of("calibrated_sensor", one, "token"): one for one in records["calibrated_sensor"]}
    found: dict[str, dict[int, Any]] = {channel: {} for channel in wanted}
    for one in records["sample_data"]:
        if of("sample_data", one, "sample_token") not in samples:
            continue
        calibration = calibrations.get(of("sample_data", one, "calibrated_sensor_token"))
        channel = channels.get(of("calibrated_sensor", calibration, "sensor_token"), "")
        if channel in found:
            found[channel][int(of("sample_data", one, "timestamp"))] = (of("sample_data", one, "filename"), calibration)
    out = []
    for channel, by_stamp in found.items():
        if not by_stamp:
            raise EchogridError(f"{paths['sample_data']}: has no clouds of {channel} for the scene")
        stamps = sorted(by_stamp)
        calibration = by_stamp[stamps[0]][1]
        mount = [*of("calibrated_sensor", calibration, "translation"), *of("calibrated_sensor", calibration, "rotation")]
        files = [str(by_stamp[stamp][0]) for stamp in stamps]
        out.append(Clouds(np.array(stamps, dtype=np.int64), files, np.array(mount, dtype=np.float64)))
    return out


def recording(source: Source) -> Recording:
    """The scene in echogrid's units and frames."""
    for name, table in (("zoe_veh_info", source.wheels), ("ms_imu", source.imu), ("pose", source.pose)):
        if len(table) < 2:
            raise EchogridError(f"{source.name}: has {len(table)} rows of {name}, expected many")
    scans = []
    for radar, sweeps in source.sweeps.items():
        for stamp_us, clusters in zip(sweeps.stamp_us.tolist(), sweeps.clusters, strict=True):
            scans.append(scan_of(RADARS[radar], 1000 * stamp_us, clusters))
    pose_us, x, y, qw, qx, qy, qz, speed = source.pose.T
    wheel_speed = source.wheels[:, 1:] * (2 * math.pi / 60 * WHEEL_RADIUS)
    wheel_speed[np.interp(source.wheels[:, 0], pose_us, speed) < REVERSE] *= -1
    return Recording(
        vehicle=source.name,
        body=BODY,
        radars=tuple(RadarMount(RADARS[radar], _base_from_sensor(sweeps.mount), FOV) for radar, sweeps in source.sweeps.items()),
        scans=scans,
        motion=Motion(_ns(source.wheels[:, 0]), wheel_speed, _ns(source.imu[:, 0]), source.imu[:, 1]),
        truth=truth_from(_ns(pose_us), x, y, yaw_of(qw, qx, qy, qz)),
    )


def scan_of(sensor: str, stamp_ns: int, clusters: Floats) -> RadarScan:
    """One radar's scan of clusters (N, 5) as CLUSTER names them; without a range there is no range rate (NaN)."""
    x, y, rcs, vx, vy = clusters.T
    distance = np.hypot(x, y)
    range_rate = np.divide(x * vx + y * vy, distance, out=np.full(len(x), np.nan), where=distance > 0)
    return RadarScan(sensor, stamp_ns, stamp_ns, distance, np.arctan2(y, x), range_rate, rcs)


def yaw_of(qw: Floats, qx: Floats, qy: Floats, qz: Floats) -> Floats:
    """The heading (rad) of quaternions: of their x axis, seen from above."""
    return np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))


def _base_from_sensor(mount: Floats) -> SE2:
    return SE2(float(mount[0]), float(mount[1]), float(yaw_of(*mount[3:7])))


def _ns(stamp_us: Floats) -> NDArray[np.int64]:
    return np.round(stamp_us).astype(np.int64) * 1000
