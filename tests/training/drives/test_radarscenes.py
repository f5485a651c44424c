"""The RadarScenes importer on a sequence made here, written in both layouts."""

from __future__ import annotations

import json
import math
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.support.npz_files import changed
from tests.support.radarscenes_files import MOUNTS, Made, write_compact, write_official

from echogrid.errors import EchogridError
from echogrid_training.drives import radarscenes
from echogrid_training.drives.can_writer import can_frames
from echogrid_training.recording import EPOCH_NS

NAMES = {1: "right", 2: "front_right", 3: "front_left", 4: "left"}


@pytest.fixture
def made() -> Made:
    rng = np.random.default_rng(4)
    low, high = (1, -1.2, -20, -30), (99, 1.2, 20, 30)
    scans = [
        (
            sensor,
            4_321 + 75_003 * turn + 17_000 * sensor,
            rng.uniform(low, high, (count, 4)).astype(np.float32),
        )
        for turn in range(3)
        for sensor, count in zip((1, 2, 3, 4), (70, 5, 9, 1), strict=True)
    ]
    times = np.array([17_000 * step + step % 3 for step in range(12)])  # the odometry sample of each scan, in order
    return Made(scans, times, rng.uniform((1500, 500, -1, 0, -1), (1600, 600, 1, 20, 1), (12, 5)).astype(np.float32))


def test_both_layouts_give_the_same_frames(made: Made, tmp_path: Path) -> None:
    compact = radarscenes.load(write_compact(made, tmp_path / "sequence_9.npz"))
    official = radarscenes.load(write_official(made, tmp_path / "data" / "sequence_9"))
    logs = [[(frame.timestamp, frame.arbitration_id, bytes(frame.data)) for frame in can_frames(one)[0]] for one in (compact, official)]
    assert logs[0] == logs[1]
    assert compact.radars == official.radars
    assert compact.vehicle == official.vehicle == "radarscenes-sequence_9"
    for name in ("stamp_ns", "x", "y", "yaw"):
        np.testing.assert_array_equal(getattr(compact.truth, name), getattr(official.truth, name))


def test_units_frames_and_signs(made: Made, tmp_path: Path) -> None:
    recording = radarscenes.load(write_official(made, tmp_path / "sequence_9"))
    assert {radar.name: radar.base_from_sensor.yaw for radar in recording.radars} == {NAMES[n]: MOUNTS[n][2] for n in MOUNTS}
    first_us = min(stamp for _, stamp, _ in made.scans)
    by_time = {(scan.sensor, scan.stamp_ns): scan for scan in recording.scans}
    assert len(by_time) == len(made.scans)
    for sensor, stamp, rows in made.scans:
        scan = by_time[NAMES[sensor], EPOCH_NS + 1000 * (stamp - first_us)]
        np.testing.assert_array_equal(np.stack((scan.range, scan.azimuth, scan.range_rate, scan.rcs), axis=-1), rows)
    motion = recording.motion
    assert set(np.diff(motion.wheel_stamp_ns)) == {10_000_000}
    assert motion.wheel_stamp_ns[0] == EPOCH_NS - 1000 * first_us
    np.testing.assert_allclose(motion.wheel_speed[0], made.odometry[0, 3])
    between = made.odometry[0, 3] + (made.odometry[1, 3] - made.odometry[0, 3]) * 10_000 / 17_001
    np.testing.assert_allclose(motion.wheel_speed[1], between, rtol=1e-6)
    assert motion.yaw_rate[0] == made.odometry[0, 4]
    distance = math.hypot(*(made.odometry[-1, :2] - made.odometry[0, :2]))
    assert math.hypot(recording.truth.x[-1], recording.truth.y[-1]) == pytest.approx(distance)
    assert (recording.truth.x[0], recording.truth.y[0], recording.truth.yaw[0]) == (0.0, 0.0, 0.0)


def test_mounts_may_lie_in_the_sequence(made: Made, tmp_path: Path) -> None:
    folder = write_official(made, tmp_path / "sequence_9")
    (tmp_path / "sensors.json").rename(folder / "sensors.json")
    assert len(radarscenes.load(folder).radars) == 4


def test_bad_compact_files_are_one_sentence(made: Made, tmp_path: Path) -> None:
    path = write_compact(made, tmp_path / "seq.npz")
    for changes, sentence in (
        ({"radar3_off": None}, "changed.npz: has no array 'radar3_off', found "),
        ({"radar3_off": np.zeros(3)}, "changed.npz: the lengths of radar3_det, radar3_off and radar3_odom do not fit together"),
        ({"radar3_det": np.zeros((27, 3))}, r"have the shapes \(27, 3\) and \(3, 7\), expected 10 and 7 columns"),
        ({"mount_x_y_yaw": np.zeros(12)}, r"changed.npz: mount_x_y_yaw has the shape \(12,\), expected \(4, 3\)"),
    ):
        with pytest.raises(EchogridError, match=sentence):
            radarscenes.load(changed(path, **changes))


def test_bad_official_folders_are_one_sentence(made: Made, tmp_path: Path) -> None:
    folder = write_official(made, tmp_path / "sequence_9")
    data, sensors = folder / "radar_data.h5", tmp_path / "sensors.json"

    def sentence() -> str:
        with pytest.raises(EchogridError) as caught:
            radarscenes.load(folder)
        return str(caught.value)

    mounts = json.loads(sensors.read_text())
    sensors.write_text(json.dumps(mounts | {"radar_2": {"x": "far", "y": 0, "yaw": 0}}))
    assert sentence().startswith(f"{sensors}: radar_2 needs numbers for x, y and yaw")
    sensors.write_text(json.dumps({"radar_1": mounts["radar_1"]}))
    assert sentence() == f"{sensors}: an object has no key 'radar_2', found radar_1"
    sensors.unlink()
    assert sentence() == f"{folder}/sensors.json: does not exist, nor does {sensors}; expected the radars' mounts in one of them"

    with h5py.File(data, "a") as file:
        del file["odometry"]
    assert sentence() == f"{data}: has no rows in 'odometry', found radar_data"
    with h5py.File(data, "a") as file:
        file["odometry"] = np.zeros(3, dtype=[("timestamp", "<i8"), ("x_seq", "<f4")])
    assert sentence() == f"{data}: 'odometry' has no field 'y_seq', found timestamp, x_seq"
    data.write_bytes(b"hello")
    assert sentence().startswith(f"{data}: is not an HDF5 file that can be read")
    data.unlink()
    assert sentence() == f"{data}: does not exist, expected the radar data of a RadarScenes sequence"
