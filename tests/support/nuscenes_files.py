"""nuScenes' files for tests: a scene made here, written in both layouts."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

START_US = 1_532_402_927_000_000
FIELDS = ["x", "y", "z", "dyn_prop", "id", "rcs", "vx", "vy", "vx_comp", "vy_comp", "is_quality_valid", "ambig_state"]
FIELDS += ["x_rms", "y_rms", "invalid_state", "pdh0", "vx_rms", "vy_rms"]
KINDS = ["f4"] * 3 + ["i1", "i2"] + ["f4"] * 5 + ["i1"] * 8
POINT = np.dtype(list(zip(FIELDS, (f"<{kind}" for kind in KINDS), strict=True)))
WHEELS = ("FL_wheel_speed", "FR_wheel_speed", "RL_wheel_speed", "RR_wheel_speed")
YAWS = {"FRONT_LEFT": 90.0, "FRONT_RIGHT": -90.0, "BACK_LEFT": 175.0, "BACK_RIGHT": -175.0}


@dataclass
class Made:
    """What both layouts are to hold."""

    clouds: dict[str, list[np.ndarray]]  # POINT arrays by radar
    stamps: dict[str, list[int]]  # µs
    mounts: dict[str, list[float]]  # x, y, z, qw, qx, qy, qz
    wheels: list[dict[str, float]]
    imu: list[dict[str, Any]]
    pose: list[dict[str, Any]]


def two_samples() -> Made:
    """A scene of four sweeps of each radar."""
    rng = np.random.default_rng(8)
    clouds, stamps, mounts = {}, {}, {}
    for number, (radar, yaw_deg) in enumerate(YAWS.items()):
        clouds[radar] = []
        for count in (3, 0, 90, 12):
            points = np.zeros(count, dtype=POINT)
            for name in ("x", "y", "rcs", "vx", "vy"):
                points[name] = rng.uniform(1.0, 40.0, count)
            clouds[radar].append(points)
        stamps[radar] = [START_US + 1003 * number + 74_001 * sweep for sweep in range(4)]
        half = math.radians(yaw_deg) / 2
        mounts[radar] = [2.4 - 0.7 * number, 0.5 if yaw_deg > 0 else -0.5, 0.7, math.cos(half), 0.0, 0.0, math.sin(half)]
    times = [START_US + 10_003 * step for step in range(30)]
    wheels = [{"utime": time} | {wheel: 200.0 + 3.0 * n for n, wheel in enumerate(WHEELS)} for time in times]
    imu = [{"utime": time, "rotation_rate": [0.5, 0.6, 0.01 * n]} for n, time in enumerate(times)]
    pose = []
    for n, time in enumerate(times):
        half = 1.0 + 0.005 * n
        pose.append({"utime": time, "pos": [400.0 + n, 1100.0 - n, 0.0], "vel": [6.2, 0.0, 0.0]})
        pose[-1]["orientation"] = [math.cos(half), 0.0, 0.0, math.sin(half)]
    return Made(clouds, stamps, mounts, wheels, imu, pose)


def write_compact(made: Made, path: Path) -> Path:
    arrays: dict[str, Any] = {"det_fields": np.array(FIELDS)}
    for radar, clouds in made.clouds.items():
        rows = [[float(point[name]) for name in FIELDS] for cloud in clouds for point in cloud]
        arrays[f"{radar}_det"] = np.array(rows, dtype=np.float32)
        arrays[f"{radar}_off"] = np.cumsum([0, *(len(cloud) for cloud in clouds)])
        arrays[f"{radar}_t_us"] = np.array(made.stamps[radar], dtype=np.float64)
        arrays[f"{radar}_calib_txyz_qwxyz"] = np.array(made.mounts[radar])
    arrays["can_zoe_veh_info"] = np.array([list(one.values()) for one in made.wheels])
    arrays["can_zoe_veh_info_fields"] = np.array(list(made.wheels[0]))
    arrays["can_ms_imu"] = np.array([[one["utime"], *one["rotation_rate"]] for one in made.imu])
    arrays["can_ms_imu_fields"] = np.array(["utime", "rotation_rate_x", "rotation_rate_y", "rotation_rate_z"])
    arrays["can_pose"] = np.array([[one["utime"], *one["orientation"], *one["pos"], *one["vel"]] for one in made.pose])
    names = ["utime", "orientation_1", "orientation_2", "orientation_3", "orientation_4", "px", "py", "pz", "vx", "vy", "vz"]
    arrays["can_pose_fields"] = np.array(names)
    np.savez(path, **arrays)
    return path


def pcd(points: np.ndarray) -> bytes:
    sizes, kinds = [kind[1] for kind in KINDS], [kind[0].upper() for kind in KINDS]
    header = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7", "FIELDS " + " ".join(FIELDS), "SIZE " + " ".join(sizes)]
    header += ["TYPE " + " ".join(kinds), "COUNT" + " 1" * 18, f"WIDTH {len(points)}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0"]
    return "\n".join([*header, f"POINTS {len(points)}", "DATA binary\n"]).encode() + points.tobytes()


def write_official(made: Made, root: Path, scene: str = "scene-0001") -> Path:
    """Two samples of the scene, one of another; keyframes in samples/, the rest in sweeps/."""
    tables: dict[str, list[dict[str, Any]]] = {
        "scene": [{"token": "s1", "name": scene}, {"token": "s2", "name": "scene-0002"}],
        "sample": [
            {"token": "a", "scene_token": "s1"},
            {"token": "b", "scene_token": "s1"},
            {"token": "c", "scene_token": "s2"},
        ],
        "sensor": [{"token": "lidar", "channel": "LIDAR_TOP"}],
        "calibrated_sensor": [{"token": "cal_lidar", "sensor_token": "lidar", "translation": [0, 0, 0], "rotation": [1, 0, 0, 0]}],
        "sample_data": [
            {"sample_token": "a", "calibrated_sensor_token": "cal_lidar", "timestamp": START_US, "filename": "samples/LIDAR_TOP/0.pcd.bin"}
        ],
    }
    for radar, clouds in made.clouds.items():
        channel, mount = f"RADAR_{radar}", made.mounts[radar]
        tables["sensor"].append({"token": radar, "channel": channel})
        tables["calibrated_sensor"].append(
            {"token": f"cal_{radar}", "sensor_token": radar, "translation": mount[:3], "rotation": mount[3:]}
        )
        for index, (cloud, stamp) in reversed(list(enumerate(zip(clouds, made.stamps[radar], strict=True)))):
            name = f"{'samples' if index % 2 == 0 else 'sweeps'}/{channel}/{stamp}.pcd"
            empty = np.zeros(1, dtype=POINT)
            empty["x"] = np.nan  # so nuScenes writes a cloud without points
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_bytes(pcd(cloud if len(cloud) else empty))
            record = {"sample_token": "ab"[index // 2], "calibrated_sensor_token": f"cal_{radar}", "timestamp": stamp, "filename": name}
            tables["sample_data"].append(record)
        other = {"sample_token": "c", "calibrated_sensor_token": f"cal_{radar}", "timestamp": START_US + 5, "filename": "not/there.pcd"}
        tables["sample_data"].append(other)
    (root / "v1.0-mini").mkdir(parents=True)
    for table, records in tables.items():
        (root / "v1.0-mini" / f"{table}.json").write_text(json.dumps(records))
    (root / "can_bus").mkdir()
    for kind, rows in (("zoe_veh_info", made.wheels), ("ms_imu", made.imu), ("pose", made.pose)):
        (root / "can_bus" / f"{scene}_{kind}.json").write_text(json.dumps(rows))
    return root
