"""A street written down as each data set's documentation has it, brought, labelled, and compared with what truly stands there."""

from __future__ import annotations

import datetime
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.support.nuscenes_files import two_samples, write_official
from tests.training.layouts.conftest import Street

from echogrid.config.loading import load_config
from echogrid.core.motion.se2 import SE2
from echogrid_training import cli
from echogrid_training.evaluation.recorded.drive import hear
from echogrid_training.labelling.lidar_mount import LidarMount, base_from_lidar, load_mount
from echogrid_training.labelling.odometry import load_poses
from echogrid_training.layouts.nuscenes_lidar import rotation
from echogrid_training.layouts.with_lidar import mount_text
from echogrid_training.realism.figures import residual_of
from echogrid_training.truth.simulated_truth import load_simulated_truth

CAMERA_FROM_AHEAD = np.array(((0, -1, 0, 0.06), (0, 0, -1, -0.08), (1, 0, 0, -0.27), (0, 0, 0, 1.0)))  # of axes x ahead, y left, z up


def four(pose: SE2, z: float = 0.0) -> np.ndarray:
    """(4, 4) of a pose on the plane."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return np.array(((c, -s, 0, pose.x), (s, c, 0, pose.y), (0, 0, 1, z), (0, 0, 0, 1.0)))


def floats(path: Path, points: np.ndarray, *more: float) -> None:
    """A .bin file of points and columns behind them."""
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = np.concatenate((points, np.tile(more, (len(points), 1))), axis=1)
    path.write_bytes(columns.astype("<f4").tobytes())


def check(street: Street, out: Path) -> None:
    """Poses are the street's, and so is the truth that comes of it."""
    poses = load_poses(out / "poses.npz")
    assert poses is not None
    assert len(poses.stamp_ns) == len(street.poses)
    start = street.poses[0].inverse()
    for index, pose in enumerate(street.poses):
        wanted = start @ pose
        assert (poses.x[index], poses.y[index], poses.yaw[index]) == pytest.approx((wanted.x, wanted.y, wanted.yaw), abs=5e-3)
    assert cli.main(["label", str(out)]) == 0
    occupied, free = street.agreement(load_simulated_truth(out / "truth.npz"))
    assert occupied >= 0.9
    assert free >= 0.97


def check_motion(street: Street, out: Path) -> None:
    """The bus says how the car went, and radars what stands."""
    drive = hear(out)
    steady = [ego for _, ego in drive.scans[8:-8]]
    assert np.mean([ego.speed for ego in steady]) == pytest.approx(6.0, abs=0.05)
    assert np.mean([ego.yaw_rate for ego in steady]) == pytest.approx(0.05, abs=0.005)
    mounts = {radar.name: radar.mount() for radar in load_config(drive.config).radar}
    off = np.concatenate([residual_of(scan, mounts[scan.sensor], ego.speed, ego.yaw_rate) for scan, ego in drive.scans])
    assert len(off) > 100
    assert np.median(np.abs(off)) < 0.2


def in_velodyne(points: np.ndarray) -> np.ndarray:
    """KITTI's: 0.76 m ahead of the rear axle, 1.73 m above the road, axes as base's."""
    return points - (0.76, 0.0, 1.73)


def test_kitti_raw(street: Street, tmp_path: Path) -> None:
    street = street.with_lidar_at(0.76)
    drive, radius = tmp_path / "2011_09_26_drive_0001_sync", 6378137.0
    (drive / "oxts" / "data").mkdir(parents=True)
    lines, latitude = [], 49.0
    scale = math.cos(math.radians(latitude))
    for number, (stamp, points, pose) in enumerate(zip(street.stamp_ns, street.points, street.poses, strict=True)):
        floats(drive / "velodyne_points" / "data" / f"{number:010d}.bin", in_velodyne(points), 0.5)
        imu = SE2(5000.0, 900.0, 0.4) @ pose @ SE2(-0.05, 0.32, 0.0)
        north = radius * math.log(math.tan(math.pi * (90 + latitude) / 360)) * scale + imu.y
        lat = math.degrees(2 * math.atan(math.exp(north / scale / radius)) - math.pi / 2)
        lon = math.degrees(imu.x / scale / radius)
        row = [lat, lon, 116.0, 0.01, -0.02, imu.yaw, *[0.0] * 24]
        (drive / "oxts" / "data" / f"{number:010d}.txt").write_text(" ".join(f"{one:.15g}" for one in row) + "\n")
        whole = datetime.datetime.fromtimestamp(stamp // 10**9, datetime.UTC).strftime("%Y-%m-%d %H:%M:%S")
        lines.append(f"{whole}.{stamp % 10**9:09d}\n")
    for folder in ("velodyne_points", "oxts"):
        (drive / folder / "timestamps.txt").write_text("".join(lines))
    out = tmp_path / "out"
    assert cli.main(["import", "kitti", str(drive), "--out", str(out)]) == 0
    check(street, out)
    check_motion(street, out)
    assert "-played-radars" in (out / "echogrid.toml").read_text()


def test_kitti_odometry(street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    street = street.with_lidar_at(0.76)
    sequence = tmp_path / "04"
    velodyne = [four(pose) @ four(SE2(0.76, 0.0, 0.0), 1.73) for pose in street.poses]
    first = CAMERA_FROM_AHEAD @ np.linalg.inv(velodyne[0])
    rows = [(first @ one @ np.linalg.inv(CAMERA_FROM_AHEAD))[:3].reshape(-1) for one in velodyne]
    for number, points in enumerate(street.points):
        floats(sequence / "velodyne" / f"{number:06d}.bin", in_velodyne(points), 0.5)
    (sequence / "times.txt").write_text("".join(f"{(stamp - street.stamp_ns[0]) * 1e-9:.6e}\n" for stamp in street.stamp_ns))
    numbers = " ".join(f"{one:.12e}" for one in CAMERA_FROM_AHEAD[:3].reshape(-1))
    (sequence / "calib.txt").write_text(f"P0: {' '.join('0' * 12)}\nTr: {numbers}\n")
    out = tmp_path / "out"
    assert cli.main(["import", "kitti", str(sequence), "--out", str(out)]) == 1
    assert "poses.txt: is not there; the benchmark keeps it as poses/04.txt" in capsys.readouterr().err
    (sequence / "poses.txt").write_text("".join(" ".join(f"{one:.9e}" for one in row) + "\n" for row in rows))
    assert cli.main(["import", "kitti", str(sequence), "--out", str(out)]) == 0
    check(street, out)
    check_motion(street, out)


def test_a_compact_kitti_file(street: Street, tmp_path: Path) -> None:
    street = street.with_lidar_at(0.76)
    velodyne = [four(pose) @ four(SE2(0.76, 0.0, 0.0), 1.73) for pose in street.poses]
    points = [np.rint(in_velodyne(one) / 0.005).astype(np.int16) for one in street.points]
    matrices = np.array([np.linalg.inv(velodyne[0]) @ one for one in velodyne])
    np.savez(tmp_path / "k.npz", xyz_5mm=np.concatenate(points), offsets=np.cumsum([0, *map(len, points)]), poses_kissicp=matrices)
    assert cli.main(["import", "kitti", str(tmp_path / "k.npz"), "--out", str(tmp_path / "out")]) == 0
    check(street, tmp_path / "out")


def delft(street: Street, root: Path, sign: float = 1.0) -> None:
    """Frames 00010 on; a camera that looks down a little, 2.1 m ahead of the axle and 1.3 m up; a radar that is turned by 2°."""
    tilt = four(SE2(0, 0, 0))
    tilt[:3, :3] = base_from_lidar(LidarMount(x=0, y=0, z=1, pitch_deg=6.8)).rotation
    base_from_camera = four(SE2(2.1, 0.05, 0.0), 1.3) @ tilt @ np.linalg.inv(CAMERA_FROM_AHEAD)
    base_from_lidar_ = four(SE2(1.2, 0.0, 0.0), 1.65)
    base_from_radar = four(SE2(3.55, 0.0, math.radians(2.0)), 0.5)
    rng = np.random.default_rng(4)
    for number, (points, pose) in enumerate(zip(street.points, street.poses, strict=True), 10):
        homogeneous = np.concatenate((points, np.ones((len(points), 1))), axis=1)
        floats(
            root / "lidar" / "training" / "velodyne" / f"{number:05d}.bin", (homogeneous @ np.linalg.inv(base_from_lidar_).T)[:, :3], 0.3
        )
        seen = (homogeneous @ np.linalg.inv(base_from_radar).T)[:, :3]
        stands = (points[:, 2] > 0.4) & (points[:, 2] < 1.6) & (seen[:, 0] > 3.0) & (np.abs(seen[:, 1]) < seen[:, 0])
        seen = seen[rng.permutation(np.flatnonzero(stands))[:60]]
        azimuth = np.arctan2(seen[:, 1], seen[:, 0])
        moved = np.array((6.0, 0.05 * 3.55)) @ np.array(((math.cos(0.0349), -math.sin(0.0349)), (math.sin(0.0349), math.cos(0.0349))))
        rate = -sign * (moved[0] * np.cos(azimuth) + moved[1] * np.sin(azimuth))
        rows = np.stack((rng.normal(-5, 5, len(seen)), rate, np.zeros(len(seen)), np.zeros(len(seen))), axis=-1)
        floats(root / "radar" / "training" / "velodyne" / f"{number:05d}.bin", np.concatenate((seen, rows), axis=1))
        camera = (four(SE2(-25.0, -27.0, 2.1)) @ four(pose) @ base_from_camera).reshape(-1).tolist()
        path = root / "radar" / "training" / "pose" / f"{number:05d}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(json.dumps({name: camera}) for name in ("odomToCamera", "mapToCamera", "UTMToCamera")))
        for kind, place in (("lidar", base_from_lidar_), ("radar", base_from_radar)):
            matrix = (np.linalg.inv(base_from_camera) @ place)[:3].reshape(-1)
            path = root / kind / "training" / "calib" / f"{number:05d}.txt"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"R0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: {' '.join(f'{one:.12f}' for one in matrix)}\nTr_imu_to_velo: \n")


def test_view_of_delft(street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    street = street.with_lidar_at(1.2)
    delft(street, tmp_path / "vod")
    out = tmp_path / "out"
    assert cli.main(["import", "vod", str(tmp_path / "vod"), "--frames", "10-99", "--out", str(out)]) == 0
    config = load_config(out / "echogrid.toml")
    assert [(radar.name, round(radar.x, 2), round(radar.y, 2), round(radar.yaw_deg, 1)) for radar in config.radar] == [
        ("front", 3.55, 0.0, 2.0)
    ]
    check_motion(street, out)
    poses = load_poses(out / "poses.npz")
    assert poses is not None
    assert cli.main(["label", str(out)]) == 0
    # Its frames carry no time: they are 100 ms apart by their number.
    truth = load_simulated_truth(out / "truth.npz")
    late = int(truth.stamp_ns[0]) - street.stamp_ns[0]
    occupied, free = replace(street, stamp_ns=[stamp + late for stamp in street.stamp_ns]).agreement(truth)
    assert occupied >= 0.9
    assert free >= 0.97
    assert "1 radars" in capsys.readouterr().out


def test_nuscenes_with_its_lidar(street: Street, tmp_path: Path) -> None:
    """LIDAR_TOP's axes are x right, y ahead, z up; its stamps are of the end of a turn of 50 ms."""
    scene = two_samples()
    root = write_official(scene, tmp_path / "nuscenes")
    turned = [0.7071067811865476, 0.0, 0.0, -0.7071067811865476]
    tables = root / "v1.0-mini"
    calibrated = json.loads((tables / "calibrated_sensor.json").read_text())
    mount = next(one for one in calibrated if one["token"] == "cal_lidar")
    mount |= {"translation": [0.94, 0.0, 1.84], "rotation": turned}
    (tables / "calibrated_sensor.json").write_text(json.dumps(calibrated))
    records = [one for one in json.loads((tables / "sample_data.json").read_text()) if "LIDAR" not in one["filename"]]
    first_us = min(min(stamps) for stamps in scene.stamps.values())
    ahead = street.points[0] - (0.94, 0.0, 1.84)
    for number in range(3):
        stamp = first_us + 50_000 * number
        name = f"{'samples' if number == 0 else 'sweeps'}/LIDAR_TOP/{stamp}.pcd.bin"
        floats(root / name, np.stack((-ahead[:, 1], ahead[:, 0], ahead[:, 2]), axis=-1), 17.0, 3.0)
        records.append({"sample_token": "a", "calibrated_sensor_token": "cal_lidar", "timestamp": stamp, "filename": name})
    (tables / "sample_data.json").write_text(json.dumps(records))
    out = tmp_path / "out"
    assert cli.main(["import", "nuscenes", str(root), "--scene", "scene-0001", "--lidar", "--out", str(out)]) == 0
    pose = base_from_lidar(load_mount(out / "lidar.toml"))
    assert load_mount(out / "lidar.toml").latency_ms == 25.0
    with np.load(out / "lidar.npz") as held:
        assert held["stamp_ns"].tolist() == [1000 * (first_us + 50_000 * number) for number in range(3)]
        found = pose.apply(held["xyz_cm"][: held["offsets"][1]] / 100)
    near = street.points[0][((street.points[0] - (0.94, 0.0, 1.84)) ** 2).sum(axis=1) < 45.0**2]
    np.testing.assert_allclose(found, near, atol=0.012)


def test_a_mount_comes_back() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        quaternion = rng.normal(size=4)
        pose = base_from_lidar(LidarMount(x=1, y=2, z=3, yaw_deg=float(rng.uniform(-180, 180)), pitch_deg=8.0, roll_deg=-170.0))
        path = dict(line.split(" = ") for line in mount_text(pose).splitlines())
        again = base_from_lidar(LidarMount(**{name: float(value) for name, value in path.items()}))
        np.testing.assert_allclose(again.rotation, pose.rotation, atol=1e-5)
        turn = rotation(quaternion)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        axis = quaternion[1:]
        np.testing.assert_allclose(turn @ axis, axis, atol=1e-12)  # a rotation leaves its axis where it is


def test_mistakes_are_one_sentence(street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root, wrong, torn = tmp_path / "vod", tmp_path / "wrong", tmp_path / "torn"
    for folder, sign in ((root, 1.0), (wrong, -1.0), (torn, 1.0)):
        delft(street, folder, sign)
    (torn / "radar" / "training" / "velodyne" / "00012.bin").write_bytes(b"\0" * 40)
    (root / "radar" / "training" / "pose" / "00034.json").write_text('{"mapToCamera": []}')
    raw = tmp_path / "raw"
    (raw / "velodyne_points" / "data").mkdir(parents=True)
    (raw / "velodyne_points" / "timestamps.txt").write_text("yesterday\n")
    out = ["--out", str(tmp_path / "out")]
    for arguments, expected in (
        (["vod", str(tmp_path), "--frames", "0-9"], "velodyne: there is no such folder; expected View of Delft's official layout"),
        (["vod", str(root), "--frames", "500-600"], "has 0 turns of the frames 00500 to 00600, expected many"),
        (["vod", str(root), "--frames", "30-60"], "00034.json: no line has the key 'odomToCamera'"),
        (["vod", str(wrong), "--frames", "10-20"], "v_r has the other sign"),
        (["vod", str(torn), "--frames", "10-20"], "00012.bin: holds 10 numbers, expected 7 for each point"),
        (["kitti", str(tmp_path / "none")], "none: does not exist, expected a folder of KITTI's raw data"),
        (["kitti", str(tmp_path)], "holds neither velodyne_points (raw data) nor velodyne (odometry benchmark)"),
        (["kitti", str(raw)], "timestamps.txt: line 1: 'yesterday' is no time such as"),
        (["nuscenes", str(tmp_path / "none"), "--lidar"], "none: there is no such folder; expected nuScenes' official layout"),
        (["nuscenes", str(tmp_path), "--lidar"], "holds no v1.0-* tables; the lidar is in the official layout alone"),
    ):
        assert cli.main(["import", *arguments, *out]) == 1
        printed = capsys.readouterr()
        assert expected in printed.err
        assert printed.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
