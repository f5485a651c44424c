"""What is written, cantools reads back; checksums are those of the catalogue."""

from __future__ import annotations

import itertools
import math
import zlib
from typing import Any

import can
import numpy as np
import pytest
from tests.support.frames import CLASSIC, MOTION, RADAR, crc8, crc16
from tests.support.recordings import make_recording, random_detections, scan_of

from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid_training.drives.can_writer import can_frames
from echogrid_training.recording import EPOCH_NS

HALF_LSB = np.array((0.015625, 0.0002, 0.01, 0.5)) / 2


def test_the_slow_checksums_have_the_catalogue_check_values() -> None:
    assert (zlib.crc32(b"123456789"), crc16(b"123456789"), crc8(b"123456789")) == (0xCBF43926, 0x29B1, 0x4B)


def cycles(frames: list[can.Message], first_id: int, width: int) -> list[list[can.Message]]:
    """One radar's frames by cycle: each header with what follows it."""
    grouped: list[list[can.Message]] = []
    for frame in frames:
        if frame.arbitration_id == first_id:
            grouped.append([])
        if first_id <= frame.arbitration_id < first_id + width:
            grouped[-1].append(frame)
    return grouped


def detections_of(decoded: list[dict[str, Any]], fd: bool) -> Floats:
    """(N, 4) of the valid ones."""
    ends = [f"_{k}" for k in range(1, 9)] if fd else [""]
    rows = [
        [page[name + end] for name in ("Range", "Azimuth", "RangeRate", "Rcs")] for page in decoded for end in ends if page[f"Valid{end}"]
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


@pytest.mark.parametrize("fd", [True, False])
def test_scans_are_read_back_within_half_a_step(fd: bool) -> None:
    recording = make_recording(counts=(5, 0, 64, 17), period_ns=100_000_000)
    frames, wirings, report = can_frames(recording, fd)
    dbc = RADAR if fd else CLASSIC
    width, checksum, place, size = (0x10, zlib.crc32, 8, 4) if fd else (0x80, crc16, 6, 2)
    for number, radar in enumerate(recording.radars):
        wiring = wirings[radar.name]
        assert (wiring.bus, wiring.id_offset) == (0, width * number)
        of_radar = cycles(frames, 0x300 + wiring.id_offset, width)
        scans = [scan for scan in recording.scans if scan.sensor == radar.name]
        assert len(of_radar) == len(scans)
        for counter, (group, scan) in enumerate(zip(of_radar, scans, strict=True)):
            head, *pages = [
                dbc.decode_message(frame.arbitration_id - wiring.id_offset, frame.data, decode_choices=False) for frame in group
            ]
            assert all(frame.is_fd == fd and not frame.is_extended_id for frame in group)
            assert {page["CycleCounter"] for page in (head, *pages)} == {counter}
            assert head["DetectionCount"] == len(scan)
            if fd:
                assert [page["Page"] for page in pages] == list(range(math.ceil(len(scan) / 8)))
            else:
                assert [frame.arbitration_id - group[0].arbitration_id for frame in group[1:]] == list(range(1, len(scan) + 1))
            order = np.argsort(scan.range)
            sent = np.stack((scan.range, scan.azimuth, scan.range_rate, scan.rcs), axis=-1)[order]
            assert (np.abs(detections_of(pages, fd) - sent) <= HALF_LSB + 1e-9).all()
            payload = bytes(group[0].data)
            summed = payload[:place] + payload[place + size :] + b"".join(bytes(frame.data) for frame in group[1:])
            assert head["Crc"] == checksum(summed)
            received_us = round(group[0].timestamp * 1e6)
            assert received_us - round(head["MeasurementAge"] * 1000) == scan.stamp_ns // 1000
            assert 28.0 <= head["MeasurementAge"] < 45.0
    assert (report.sent, report.beyond_nearest, report.unencodable) == (860, 0, 0)


def test_only_the_64_nearest_are_sent() -> None:
    detections = random_detections(np.random.default_rng(3), 200)
    recording = make_recording(counts=(0,), scans=[scan_of("r0", EPOCH_NS, detections)])
    frames, _, report = can_frames(recording)
    pages = [RADAR.decode_message(frame.arbitration_id, frame.data) for frame in frames if frame.arbitration_id == 0x301]
    sent = detections_of(pages, fd=True)
    assert len(pages) == 8
    assert (np.abs(sent[:, 0] - np.sort(detections[:, 0])[:64]) <= HALF_LSB[0]).all()
    assert (report.sent, report.beyond_nearest, report.unencodable) == (64, 136, 0)


@pytest.mark.parametrize(
    ("quantity", "value"), [(0, 256.0), (0, -0.1), (1, 1.64), (1, -1.64), (2, 82.0), (2, -82.0), (3, 64.0), (3, math.nan), (2, math.inf)]
)
def test_what_no_signal_can_hold_is_left_out_and_counted(quantity: int, value: float) -> None:
    detections = random_detections(np.random.default_rng(3), 3)
    detections[1, quantity] = value
    frames, _, report = can_frames(make_recording(counts=(0,), scans=[scan_of("r0", EPOCH_NS, detections)]))
    (page,) = [RADAR.decode_message(0x301, frame.data) for frame in frames if frame.arbitration_id == 0x301]
    (head,) = [RADAR.decode_message(0x300, frame.data) for frame in frames if frame.arbitration_id == 0x300]
    assert head["DetectionCount"] == 2
    assert sorted(detections_of([page], fd=True)[:, 0]) == pytest.approx(sorted(detections[[0, 2], 0]), abs=0.008)
    assert (report.sent, report.unencodable) == (2, 1)


def test_the_ends_of_the_signals_are_sent() -> None:
    ends = np.array(((0.0, -1.6384, -81.92, -64.0), (255.984375, 1.6382, 81.91, 63.5)))
    frames, _, report = can_frames(make_recording(counts=(0,), scans=[scan_of("r0", EPOCH_NS, ends)]))
    (page,) = [RADAR.decode_message(0x301, frame.data) for frame in frames if frame.arbitration_id == 0x301]
    np.testing.assert_allclose(detections_of([page], fd=True), ends, atol=1e-9)
    assert report.unencodable == 0


def test_a_blockage_beyond_its_signal_is_an_error() -> None:
    scan = scan_of("r0", EPOCH_NS, np.zeros((0, 4)))
    blocked = type(scan)(scan.sensor, scan.stamp_ns, scan.received_ns, scan.range, scan.azimuth, scan.range_rate, scan.rcs, blockage=2.0)
    with pytest.raises(EchogridError, match="^radar 'r0': Blockage is 200 %, but corner_radar.dbc ends at 100 %$"):
        can_frames(make_recording(counts=(0,), scans=[blocked]))


def test_motion_is_read_back_within_half_a_step() -> None:
    wheels = np.random.default_rng(5).uniform(-30, 30, (40, 1)) + np.random.default_rng(6).uniform(-0.1, 0.1, (40, 4))
    wheels[:2] = 0.0
    yaw_rate = np.linspace(-6.5, 6.5, 40)
    recording = make_recording(wheel_speed=wheels, yaw_rate=yaw_rate)
    frames, _, report = can_frames(recording)
    for can_id, names, values, half in (
        (0x100, ("WheelSpeedRL", "WheelSpeedRR"), np.abs(wheels[:, :2]), 0.001),
        (0x101, ("WheelSpeedFL", "WheelSpeedFR"), np.abs(wheels[:, 2:]), 0.001),
        (0x102, ("YawRate",), yaw_rate[:, None], 0.0001),
    ):
        of_id = [frame for frame in frames if frame.arbitration_id == can_id]
        decoded = [MOTION.decode_message(can_id, frame.data, decode_choices=False) for frame in of_id]
        assert (np.abs([[one[name] for name in names] for one in decoded] - values) <= half + 1e-9).all()
        assert all(one[f"{name}Valid"] == 1 for one in decoded for name in names)
        assert [one["Counter"] for one in decoded] == [count % 16 for count in range(40)]
        assert all(one["Crc"] == frame.data[0] == crc8(bytes(frame.data[1:])) for one, frame in zip(decoded, of_id, strict=True))
        times_ns = [round(frame.timestamp * 1e6) * 1000 for frame in of_id]
        assert all(0 <= time - stamp < 2_000_000 for time, stamp in zip(times_ns, recording.motion.yaw_stamp_ns.tolist(), strict=True))
        assert not any(frame.is_fd for frame in of_id)
        if can_id == 0x100:
            rear = wheels[:, :2].mean(axis=1)
            assert [one["DirectionOfTravel"] for one in decoded] == np.where(rear > 0, 1, np.where(rear < 0, 2, 0)).tolist()
    assert report.invalid_motion == 0


def test_motion_that_no_signal_can_hold_is_sent_as_invalid() -> None:
    wheels, yaw_rate = np.full((40, 4), 3.0), np.zeros(40)
    wheels[7, 1], wheels[8, 2], yaw_rate[9] = 132.0, math.nan, 6.6
    frames, _, report = can_frames(make_recording(wheel_speed=wheels, yaw_rate=yaw_rate))
    valid = {}
    for can_id, name in ((0x100, "WheelSpeedRL"), (0x100, "WheelSpeedRR"), (0x101, "WheelSpeedFL"), (0x102, "YawRate")):
        decoded = [MOTION.decode_message(can_id, frame.data) for frame in frames if frame.arbitration_id == can_id]
        valid[name] = [one[f"{name}Valid"] for one in decoded]
    assert {name: [index for index, one in enumerate(of) if not one] for name, of in valid.items()} == {
        "WheelSpeedRL": [],
        "WheelSpeedRR": [7],
        "WheelSpeedFL": [8],
        "YawRate": [9],
    }
    assert report.invalid_motion == 3


def test_cycle_counters_wrap() -> None:
    frames, _, _ = can_frames(make_recording(counts=(1,), cycles=300))
    heads = [frame.data[0] for frame in frames if frame.arbitration_id == 0x300]
    pages = [frame.data[0] for frame in frames if frame.arbitration_id == 0x301]
    assert heads == pages == [count % 256 for count in range(300)]


@pytest.mark.parametrize("fd", [True, False])
def test_frames_of_a_bus_do_not_overlap(fd: bool) -> None:
    """The shortest that a frame can be: no stuff bits."""
    frames, _, report = can_frames(make_recording(counts=(64, 64, 64, 64), cycles=30), fd)
    assert set(report.loads) == {frame.channel for frame in frames}
    for bus, load in report.loads.items():
        of_bus = [frame for frame in frames if frame.channel == bus]
        assert load <= 0.8
        for before, frame in itertools.pairwise(of_bus):
            bits_us = 2 * 30 + (len(frame.data) * 8 + 30) / 2 if frame.is_fd else 2 * (47 + 8 * len(frame.data))
            assert frame.timestamp - before.timestamp > (bits_us - 1) / 1e6


def test_more_traffic_than_a_bus_takes_is_spread() -> None:
    frames, wirings, report = can_frames(make_recording(counts=(64, 64, 64, 64), cycles=30), fd=False)
    assert [(wiring.bus, wiring.id_offset) for wiring in wirings.values()] == [(1, 0), (1, 0x80), (2, 0), (2, 0x80)]
    assert list(report.loads) == ["can0", "can1", "can2"]
    assert {frame.arbitration_id for frame in frames if frame.channel == "can0"} == {0x100, 0x101, 0x102}


def test_the_same_seed_makes_the_same_frames() -> None:
    def log(seed: int) -> list[tuple[float, int, bytes]]:
        frames, _, _ = can_frames(make_recording(), seed=seed)
        return [(frame.timestamp, frame.arbitration_id, bytes(frame.data)) for frame in frames]

    assert log(1) == log(1) != log(2)
