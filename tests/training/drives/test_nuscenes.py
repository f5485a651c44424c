"""The nuScenes importer on a scene made here, written in both layouts."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from echogrid.errors import EchogridError
from echogrid_training.drives import nuscenes
from echogrid_training.drives.can_writer import can_frames

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


@pytest.fixture
def made() -> Made:
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


def test_both_layouts_give_the_same_frames(made: Made, tmp_path: Path) -> None:
    compact = nuscenes.load(write_compact(made, tmp_path / "scene-0001.npz"))
    official = nuscenes.load(write_official(made, tmp_path / "root"), "scene-0001")
    logs = [[(frame.timestamp, frame.arbitration_id, bytes(frame.data)) for frame in can_frames(one)[0]] for one in (compact, official)]
    assert logs[0] == logs[1]
    assert compact.radars == official.radars
    assert compact.vehicle == official.vehicle == "scene-0001"
    for name in ("stamp_ns", "x", "y", "yaw"):
        np.testing.assert_array_equal(getattr(compact.truth, name), getattr(official.truth, name))


def test_units_frames_and_signs(made: Made, tmp_path: Path) -> None:
    points = made.clouds["FRONT_LEFT"][0]
    for name, values in (("x", (3.0, 3.0, 0.0)), ("y", (4.0, -4.0, 0.0)), ("vx", (-5.0, 5.0, 1.0)), ("vy", (0.0, 5.0, 1.0))):
        points[name] = values
    recording = nuscenes.load(write_compact(made, tmp_path / "scene-0001.npz"))
    first = next(scan for scan in recording.scans if scan.sensor == "front_left")
    assert first.stamp_ns == START_US * 1000
    np.testing.assert_allclose(first.range, (5.0, 5.0, 0.0))
    np.testing.assert_allclose(first.azimuth[:2], (math.atan2(4, 3), -math.atan2(4, 3)))  # left of boresight is positive
    np.testing.assert_allclose(first.range_rate[:2], (-3.0, -1.0))  # (3·-5 + 4·0)/5 and (3·5 - 4·5)/5
    assert math.isnan(first.range_rate[2])
    np.testing.assert_array_equal(first.rcs, points["rcs"])
    turns_per_second = np.array((206.0, 209.0, 200.0, 203.0)) / 60  # rear left, rear right, front left, front right
    np.testing.assert_allclose(recording.motion.wheel_speed[0], 2 * math.pi * 0.305 * turns_per_second)
    np.testing.assert_allclose(recording.motion.yaw_rate[:3], (0.0, 0.01, 0.02))
    assert [(radar.name, round(math.degrees(radar.base_from_sensor.yaw))) for radar in recording.radars] == [
        ("front_left", 90),
        ("front_right", -90),
        ("rear_left", 175),
        ("rear_right", -175),
    ]
    truth = recording.truth
    assert (truth.x[0], truth.y[0], truth.yaw[0]) == (0.0, 0.0, 0.0)
    assert truth.yaw[-1] == pytest.approx(0.29)
    assert (truth.x[1], truth.y[1]) == pytest.approx((math.cos(2) - math.sin(2), -math.sin(2) - math.cos(2)))  # (1, -1), turned by -2 rad


def test_wheels_turn_backwards_where_the_car_does(made: Made, tmp_path: Path) -> None:
    for one in made.pose[10:]:
        one["vel"] = [-1.0, 0.0, 0.0]
    speeds = nuscenes.load(write_compact(made, tmp_path / "scene-0001.npz")).motion.wheel_speed
    assert (speeds[:10] > 0).all()
    assert (speeds[10:] < 0).all()


def test_a_scene_is_chosen_from_a_folder_of_compact_files(made: Made, tmp_path: Path) -> None:
    for name in ("scene-0001", "scene-0002"):
        write_compact(made, tmp_path / f"{name}.npz")
    assert nuscenes.load(tmp_path, "scene-0002").vehicle == "scene-0002"
    with pytest.raises(EchogridError, match="holds 2 scenes, say which with --scene: scene-0001, scene-0002$"):
        nuscenes.load(tmp_path)
    with pytest.raises(EchogridError, match="has no scene 'scene-9', found scene-0001, scene-0002$"):
        nuscenes.load(tmp_path, "scene-9")


def changed(path: Path, **changes: Any) -> Path:
    """A copy of an .npz file with other arrays, or without those that are None."""
    kept = {key: value for key, value in (dict(np.load(path)) | changes).items() if value is not None}
    copy = path.with_stem("changed")
    np.savez(copy, **kept)
    return copy


def test_bad_compact_files_are_one_sentence(made: Made, tmp_path: Path) -> None:
    path = write_compact(made, tmp_path / "scene-0001.npz")
    for changes, sentence in (
        ({"can_pose": None}, "changed.npz: has no array 'can_pose', found "),
        ({"det_fields": np.array(["q", *FIELDS[1:]])}, "changed.npz: det_fields has no 'x', found q, y, z"),
        ({"can_ms_imu": np.zeros((4, 2))}, r"changed.npz: can_ms_imu has the shape \(4, 2\), expected 4 columns"),
        ({"FRONT_LEFT_t_us": np.zeros(2)}, "changed.npz: the lengths of FRONT_LEFT_off, .* do not fit together"),
        ({"can_ms_imu": np.zeros((0, 4))}, "changed: has 0 rows of ms_imu, expected many"),
    ):
        with pytest.raises(EchogridError, match=sentence):
            nuscenes.load(changed(path, **changes))
    single = path.with_name("single.npy")
    np.save(single, np.zeros(3))
    for content in (b"", b"hello", path.read_bytes()[:2000], single.read_bytes()):
        path.write_bytes(content)
        with pytest.raises(EchogridError, match="scene-0001.npz: is not an .npz file of arrays"):
            nuscenes.load(path)


def test_bad_official_folders_are_one_sentence(made: Made, tmp_path: Path) -> None:
    root = write_official(made, tmp_path / "root")
    cloud = root / "sweeps" / "RADAR_BACK_LEFT" / f"{made.stamps['BACK_LEFT'][3]}.pcd"

    def sentence(path: Path, content: bytes | None) -> str:
        """What is said where that file has this content, or is not there."""
        before = path.read_bytes()
        path.unlink() if content is None else path.write_bytes(content)
        with pytest.raises(EchogridError) as caught:
            nuscenes.load(root, "scene-0001")
        path.write_bytes(before)
        return str(caught.value).removeprefix(f"{path}: ")

    good = cloud.read_bytes()
    assert sentence(cloud, None) == "cannot be read: No such file or directory"
    assert sentence(cloud, b"DATA ascii") == "has no line 'DATA binary', expected a binary PCD file"
    assert sentence(cloud, good[:-5]) == f"holds {12 * 43 - 5} bytes of points, expected 12 points of 43 bytes"
    assert sentence(cloud, good.replace(b"vx vy ", b"wx wy ")).startswith("has no field 'vx', found x, y, z")
    assert sentence(cloud, good.replace(b"SIZE 4", b"SIZE 9")).startswith("its PCD header is not understood")
    assert sentence(cloud, good.replace(b"POINTS 12", b"POINTS no")).startswith("its PCD header is not understood")
    assert sentence(root / "v1.0-mini" / "sensor.json", b"[").startswith("is not valid JSON")
    assert sentence(root / "v1.0-mini" / "sensor.json", b"{}") == "expected a list of records, found dict"
    assert sentence(root / "v1.0-mini" / "sample.json", None) == "cannot be read: No such file or directory"
    assert sentence(root / "v1.0-mini" / "sample.json", b'[{"token": 3}]') == "an object has no key 'scene_token', found token"
    assert sentence(root / "v1.0-mini" / "sample.json", b"[3]") == "found int where an object with 'scene_token' was expected"
    assert sentence(root / "v1.0-mini" / "calibrated_sensor.json", b"[]").endswith("where an object with 'sensor_token' was expected")
    assert "has no clouds of RADAR_FRONT_LEFT" in sentence(root / "v1.0-mini" / "sample_data.json", b"[]")
    pose = root / "can_bus" / "scene-0001_pose.json"
    assert sentence(pose, None) == "cannot be read: No such file or directory"
    assert sentence(pose, b"[]") == "expected a list of at least one object"
    assert sentence(pose, b'[{"utime": 1}]') == "an object has no key 'pos', found utime"
    assert sentence(pose, b'[{"utime": 1, "pos": []}]').startswith("expected numbers in utime, pos")
    with pytest.raises(EchogridError, match="root: holds 2 scenes, say which with --scene: scene-0001, scene-0002$"):
        nuscenes.load(root)
    with pytest.raises(EchogridError, match=r"can_bus: holds neither v1.0-\* tables nor scene-\*.npz files$"):
        nuscenes.load(root / "can_bus")
