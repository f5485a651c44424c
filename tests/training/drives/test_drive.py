"""A drive folder as a whole: the service reads from it what was recorded, and nothing is overwritten by mistake."""

from __future__ import annotations

import gzip
from pathlib import Path

import can
import numpy as np
import pytest
from tests.support.recordings import make_recording

from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.core.health import Health
from echogrid.core.messages import RadarScan, Speed, YawRate
from echogrid.errors import EchogridError
from echogrid_training.drives.drive import write_drive
from echogrid_training.recording import truth_from


@pytest.mark.parametrize("fd", [True, False])
def test_the_service_reads_what_was_recorded(tmp_path: Path, fd: bool) -> None:
    """Over two buses for the classic radars: 64 detections each 20 times a second are too many for one."""
    recording = make_recording(counts=(64, 64, 20, 0))
    folder = tmp_path / "drive"
    write_drive(recording, folder, fd=fd)
    config = load_config(folder / "echogrid.toml")
    assert len(config.bus) == (1 if fd else 2)
    for radar, mount in zip(config.radar, recording.radars, strict=True):
        ours = radar.mount()
        place = ours.base_from_sensor
        assert radar.name == mount.name
        assert (place.x, place.y, place.yaw, 2 * ours.half_fov) == pytest.approx(
            (mount.base_from_sensor.x, mount.base_from_sensor.y, mount.base_from_sensor.yaw, mount.fov), abs=1e-5
        )

    reader = SignalReader(config, folder, Health())
    with can.LogReader(folder / "can.log.gz") as log:
        read = [sample for message in log for sample in reader.add(str(message.channel), message)]
    scans = {(one.sensor, round(one.stamp_ns / 1000)): one for one in read if isinstance(one, RadarScan)}
    assert len(scans) == len(recording.scans)
    for scan in recording.scans:
        read_scan = scans[scan.sensor, scan.stamp_ns // 1000]
        np.testing.assert_allclose(read_scan.range, np.sort(scan.range), atol=0.008)
    speeds = [one.speed for one in read if isinstance(one, Speed)]
    np.testing.assert_allclose(speeds, recording.motion.wheel_speed[:, :2].mean(axis=1), atol=0.0011)
    np.testing.assert_allclose([one.yaw_rate for one in read if isinstance(one, YawRate)], recording.motion.yaw_rate, atol=0.00011)


def test_the_same_recording_makes_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "other"):
        write_drive(make_recording(), tmp_path / name)
    for file in ("echogrid.toml", "can.log.gz", "truth.npz"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes()


def test_the_log_is_a_candump_with_rising_times(tmp_path: Path) -> None:
    write_drive(make_recording(), tmp_path / "drive")
    with gzip.open(tmp_path / "drive" / "can.log.gz", "rt") as log:
        times = [float(line[1 : line.index(")")]) for line in log]
    assert all(np.diff(times) > 0)


def test_the_truth_starts_at_zero_and_keeps_its_shape(tmp_path: Path) -> None:
    """A circle, seen from its first pose: it still closes, and what lay to the left still does."""
    angles = np.linspace(0.0, 2 * np.pi, 100)
    stamps = np.arange(100)
    wall = np.array((((-1.0, -4.0), (-1.0, -3.0)),))
    truth = truth_from(stamps, 5 + 10 * np.cos(angles), -3 + 10 * np.sin(angles), np.angle(np.exp(1j * (angles + np.pi / 2))), wall)
    assert (truth.x[0], truth.y[0], truth.yaw[0]) == (0.0, 0.0, 0.0)
    assert (truth.x[-1], truth.y[-1], truth.yaw[-1]) == pytest.approx((0.0, 0.0, 2 * np.pi), abs=1e-9)
    np.testing.assert_allclose(np.hypot(truth.x, truth.y - 10.0), 10.0)  # the centre is 10 m to the left
    assert truth.walls is not None
    np.testing.assert_allclose(truth.walls, [[[-1.0, 16.0], [0.0, 16.0]]], atol=1e-9)


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(EchogridError, match=r"is not empty \(it holds 'thesis.tex'\)"):
        write_drive(make_recording(), tmp_path)
    with pytest.raises(EchogridError, match="holds 'thesis.tex', which is not part of a drive, so --force does not replace it"):
        write_drive(make_recording(), tmp_path, force=True)
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


def test_force_replaces_a_drive(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    write_drive(make_recording(), folder)
    before = (folder / "can.log.gz").read_bytes()
    with pytest.raises(EchogridError, match="is not empty"):
        write_drive(make_recording(cycles=3), folder)
    assert (folder / "can.log.gz").read_bytes() == before
    write_drive(make_recording(cycles=3), folder, force=True)
    assert (folder / "can.log.gz").read_bytes() != before
    assert [entry.name for entry in tmp_path.iterdir()] == ["drive"]


def test_a_failed_write_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("echogrid_training.drives.drive.write_truth", full)
    with pytest.raises(EchogridError, match="drive: the drive cannot be written: No space left on device"):
        write_drive(make_recording(), tmp_path / "drive")
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_run_left_is_no_hindrance(tmp_path: Path) -> None:
    (tmp_path / ".drive.partial").mkdir()
    (tmp_path / ".drive.partial" / "can.log.gz").write_text("half")
    write_drive(make_recording(cycles=3), tmp_path / "drive")
    assert [entry.name for entry in tmp_path.iterdir()] == ["drive"]
