"""The nuScenes importer on a scene made here, written in both layouts."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.support.npz_files import changed
from tests.support.nuscenes_files import FIELDS, START_US, Made, two_samples, write_compact, write_official

from echogrid.errors import EchogridError
from echogrid_training.drives import nuscenes
from echogrid_training.drives.can_writer import can_frames


@pytest.fixture
def made() -> Made:
    return two_samples()


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
        with pytest.raises(EchogridError, match="scene-0001.npz: is not an .npz file of arrays: it begins or ends otherwise$"):
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
