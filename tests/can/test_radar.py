"""Radar profiles end to end: what cantools encodes into frames comes out as scans, for our layouts and for those of real sensors."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.frames import DBC, Detection, classic_cycle, crc16, frame, radar_cycle

from echogrid.can.dbc import Dbc
from echogrid.can.profile import find, load_radar
from echogrid.can.radar import RadarReader
from echogrid.core.health import SensorHealth
from echogrid.core.kernels.scans import chosen
from echogrid.core.messages import RadarScan
from echogrid.errors import EchogridError

DETECTIONS: list[Detection] = [(3.0 + 0.7 * i, -1.2 + 0.11 * i, -9.5 + 0.8 * i) for i in range(21)]


def reader(profile: str, dbc: Path | None = None, offset: int = 0) -> tuple[RadarReader, SensorHealth]:
    path = find(profile, Path())
    loaded = load_radar(path)
    health = SensorHealth()
    return RadarReader("radar", loaded, Dbc(dbc or path.parent / str(loaded.dbc), path), offset, health), health


def feed(radar: RadarReader, messages: list[can.Message]) -> list[RadarScan]:
    scans = [radar.add(message, round(message.timestamp * 1e9)) for message in messages]
    return [scan for scan in scans if scan is not None]


def assert_same(scan: RadarScan, detections: list[Detection], tolerance: tuple[float, float, float]) -> None:
    found = np.stack((scan.range, scan.azimuth, scan.range_rate), axis=1)
    assert found.shape == (len(detections), 3)
    assert (np.abs(found - np.array(detections).reshape(-1, 3)) <= np.array(tolerance)).all()


@settings(max_examples=30)
@given(st.lists(st.tuples(st.floats(0.1, 250), st.floats(-1.6, 1.6), st.floats(-80, 80)), max_size=64), st.integers(0, 255))
def test_our_radar_within_half_a_bit(detections: list[Detection], cycle: int) -> None:
    radar, health = reader("corner_radar", offset=0x20)
    scans = feed(radar, radar_cycle(detections, cycle, 100.0, offset=0x20, age_ms=31.4))
    assert_same(scans[0], detections, (1 / 128 + 1e-9, 1e-4 + 1e-9, 0.005 + 1e-9))
    assert scans[0].stamp_ns == 100_000_000_000 - 31_400_000
    assert health == SensorHealth()


def test_the_classic_twin_says_the_same() -> None:
    fd, _ = reader("corner_radar")
    classic, _ = reader("corner_radar_classic")
    one, other = feed(fd, radar_cycle(DETECTIONS, 3, 5.0))[0], feed(classic, classic_cycle(DETECTIONS, 3, 5.0))[0]
    for name in ("range", "azimuth", "range_rate", "rcs"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.stamp_ns == other.stamp_ns


def test_a_flipped_bit_anywhere_in_the_cycle_gives_no_scan() -> None:
    messages = radar_cycle(DETECTIONS, 9, 1.0)
    for index, message in enumerate(messages):
        for byte in (2, 20 if index else 5, 11):
            broken = [
                can.Message(timestamp=m.timestamp, arbitration_id=m.arbitration_id, data=bytes(m.data), is_extended_id=False)
                for m in messages
            ]
            broken[index].data[byte] ^= 0x10
            radar, health = reader("corner_radar")
            assert feed(radar, broken) == []
            assert health.bad_crc == 1
            assert message.data != broken[index].data


def test_a_lost_page_gives_no_scan() -> None:
    radar, health = reader("corner_radar")
    first, second = radar_cycle(DETECTIONS, 1, 1.0), radar_cycle(DETECTIONS, 2, 1.05)
    assert len(feed(radar, first[:2] + first[3:] + second)) == 1
    assert health.incomplete == 1


def test_a_short_frame_is_refused() -> None:
    radar, _ = reader("corner_radar")
    with pytest.raises(ValueError, match="short"):
        radar.add(frame(0x300, bytes(8), 0.0), 0)


def test_many_frames_at_once_give_what_they_give_one_by_one() -> None:
    """With one that is too short, one flipped, one lost and one twice among them."""
    cycles = [radar_cycle([(10.0 + index, 0.1, -2.0)] * 40, index, 0.05 * index) for index in range(6)]
    cycles[1][2].data[9] ^= 1
    cycles[2][1] = can.Message(timestamp=0.1, arbitration_id=cycles[2][1].arbitration_id, is_extended_id=False, is_fd=True, data=b"\0" * 8)
    del cycles[3][2]
    cycles[4].insert(2, cycles[4][1])
    messages = [message for cycle in cycles for message in cycle]
    (one, health), (many, other) = reader("corner_radar"), reader("corner_radar")
    expected = []
    for message in messages:
        try:
            scan = one.add(message, round(message.timestamp * 1e9))
        except ValueError:
            continue
        expected += [] if scan is None else [scan]
    found = many.scans(messages, [round(message.timestamp * 1e9) for message in messages])
    assert 0 < len(found) < 6
    assert [scan.range.tobytes() + scan.azimuth.tobytes() for scan in found] == [
        scan.range.tobytes() + scan.azimuth.tobytes() for scan in expected
    ]
    assert [(scan.stamp_ns, scan.received_ns) for scan in found] == [(scan.stamp_ns, scan.received_ns) for scan in expected]
    assert other == health


def test_a_longer_frame_is_cut_to_the_message() -> None:
    """CAN FD knows no length between 48 and 64: what a message does not fill is padding."""
    radar, _ = reader("corner_radar")
    messages = radar_cycle(DETECTIONS, 1, 1.0)
    messages[0] = frame(0x300, bytes(messages[0].data) + b"\xaa" * 4, 1.0, fd=True)
    assert len(feed(radar, messages)) == 1


def test_detections_flagged_invalid_or_at_no_range_are_dropped_and_counted() -> None:
    radar, health = reader("corner_radar")
    scan = feed(radar, radar_cycle([(5.0, 0.0, 0.0), (0.0, 0.1, 0.0), (6.0, 0.2, 0.0)], 1, 1.0))[0]
    assert scan.range.tolist() == [5.0, 6.0]
    assert health.invalid == 1


def _ford(path: Path, detections: list[Detection], index: int, time: float, stray: bool = False) -> list[can.Message]:
    """One cycle of the MRR: detections, then headers, coverage last."""
    dbc = cantools.database.load_file(path, strict=False)
    messages = []
    for n, (range_, azimuth, range_rate) in enumerate(detections, 1):
        message = dbc.get_message_by_name(f"MRR_Detection_{n:03d}")
        values = {signal.name: max(0.0, signal.minimum or 0.0) for signal in message.signals}
        values |= {f"CAN_DET_RANGE_{n:02d}": range_, f"CAN_DET_AZIMUTH_{n:02d}": azimuth, f"CAN_DET_RANGE_RATE_{n:02d}": range_rate}
        values |= {f"CAN_DET_VALID_LEVEL_{n:02d}": 1, f"CAN_DET_AMPLITUDE_{n:02d}": -3}
        values[f"CAN_SCAN_INDEX_2LSB_{n:02d}"] = (index + stray) % 4
        messages.append(frame(message.frame_id, message.encode(values, strict=False), time + n * 1e-4))
    for name, given_ in (
        ("MRR_Header_InformationDetections", {"CAN_NUMBER_OF_DET": len(detections), "CAN_SCAN_INDEX": index}),
        ("MRR_Header_Timestamps", {"CAN_DET_TIME_SINCE_MEAS": 42.5}),
        ("MRR_Header_SensorCoverage", {}),
    ):
        message = dbc.get_message_by_name(name)
        values = {signal.name: max(0.0, signal.minimum or 0.0) for signal in message.signals} | given_
        messages.append(frame(message.frame_id, message.encode(values, strict=False), time + 0.01))
    return messages


def test_ford_mrr_azimuth_is_turned_round_and_the_age_comes_from_its_own_message(vendor_dbc: Callable[[str], Path]) -> None:
    path = vendor_dbc("FORD_CADS")
    radar, health = reader("ford_mrr", path)
    detections = [(10.0, 0.3, -5.0), (20.0, -0.4, 2.0)]
    scan = feed(radar, _ford(path, detections, 6, 1.0))[0]
    assert_same(scan, [(10.0, -0.3, -5.0), (20.0, 0.4, 2.0)], (1 / 128, 2e-4, 1 / 128))
    assert scan.stamp_ns == 1_010_000_000 - 42_500_000
    assert scan.rcs.tolist() == [-3.0, -3.0]
    assert health == SensorHealth()


def test_ford_mrr_detections_of_another_look_are_not_taken(vendor_dbc: Callable[[str], Path]) -> None:
    path = vendor_dbc("FORD_CADS")
    radar, health = reader("ford_mrr", path)
    assert feed(radar, _ford(path, [(10.0, 0.3, -5.0)], 6, 1.0, stray=True)) == []
    assert (health.wrong_cycle, health.incomplete) == (1, 1)


def test_mando_pages_under_one_id_and_a_checksum_after_them(vendor_dbc: Callable[[str], Path]) -> None:
    path = vendor_dbc("hyundai_kia_mando_corner_radar_generated")
    dbc = cantools.database.load_file(path, strict=False)
    detections: list[Detection] = [(4.0 + i, -0.5 + 0.125 * i, -2.0 + 0.5 * i) for i in range(12)]
    payloads = []
    head = dbc.get_message_by_name("RADAR_POINTS_METADATA_0x100")
    payloads.append((head.frame_id, head.encode({s.name: 12 if s.name == "RADAR_POINT_COUNT" else 0 for s in head.signals}, strict=False)))
    points = dbc.get_message_by_name("RADAR_POINTS_0x101")
    for number in range(3):
        values = {signal.name: max(0.0, signal.offset) for signal in points.signals} | {"MESSAGE_ID": number + 1, "LAYOUT_ID": 0}
        for k, (range_, azimuth, range_rate) in enumerate(detections[5 * number : 5 * number + 5], 1):
            values |= {f"POINT_{k}_DISTANCE": range_, f"POINT_{k}_AZIMUTH": azimuth, f"POINT_{k}_REL_VELOCITY": range_rate}
        payloads.append((points.frame_id, points.encode(values, strict=False)))
    checksum = crc16(b"".join(payload for _, payload in payloads))
    payloads.append((0x104, checksum.to_bytes(2, "little") + b"\0"))
    messages = [frame(identifier, payload, 1.0 + 0.001 * n, fd=True) for n, (identifier, payload) in enumerate(payloads)]
    radar, health = reader("mando_corner", path)
    assert_same(feed(radar, messages)[0], detections, (1 / 128, 1 / 1024, 1 / 64))
    messages[2].data[30] ^= 1
    assert feed(radar, messages) == []
    assert health.bad_crc == 1


def test_ars408_clusters_are_cartesian_and_repeat_one_id() -> None:
    radar, health = reader("ars408", offset=0x10)
    dbc = cantools.database.load_file(DBC / "ars408.dbc")
    status = {"Cluster_NofClustersNear": 2, "Cluster_NofClustersFar": 1, "Cluster_MeasCounter": 77}
    messages = [frame(0x610, dbc.encode_message("Cluster_0_Status", status), 1.0)]
    for number, (x, y, vx, vy) in enumerate(((8.0, 6.1, -5.0, 0.0), (12.0, -5.1, 1.0, 2.0), (3.0, 0.1, 0.0, 0.0))):
        values = {"Cluster_ID": number, "Cluster_DistLong": x, "Cluster_DistLat": y, "Cluster_VrelLong": vx, "Cluster_VrelLat": vy}
        values |= {"Cluster_DynProp": 0, "Cluster_RCS": 4.0}
        messages.append(frame(0x711, dbc.encode_message("Cluster_1_General", values), 1.001 + number * 1e-3))
    scan = feed(radar, messages)[0]
    expected = [(math.hypot(8, 6.1), math.atan2(6.1, 8), -5 * 8 / math.hypot(8, 6.1))]
    expected.append((math.hypot(12, 5.1), math.atan2(-5.1, 12), (12 - 2 * 5.1) / math.hypot(12, 5.1)))
    expected.append((math.hypot(3, 0.1), math.atan2(0.1, 3), 0.0))
    assert_same(scan, expected, (1e-6, 1e-6, 1e-6))
    assert scan.stamp_ns == 1_000_000_000 - 72_000_000
    assert health == SensorHealth()


def test_of_more_detections_than_we_keep_the_nearest_stay() -> None:
    radar, health = reader("srr520")
    dbc = cantools.database.load_file(DBC / "srr520.dbc")
    ranges = [2.0 + (i * 37 % 100) * 0.5 for i in range(100)]
    head = {"SequenceCounter": 8, "CycleCounter": 1, "AmbiguousVelocity": 21.4, "MaxRange": 100, "DetectionCount": 100}
    messages = [frame(0x384, dbc.encode_message("NearHeader", head, strict=False), 1.0, fd=True)]
    for number in range(50):
        values: dict[str, float] = {"MessageCounter": number, "SequenceCounter": 8}
        for k in range(10):
            distance = ranges[number * 10 + k] if number < 10 else 0.0
            values |= {f"Range_{k}": distance, f"Azimuth_{k}": 0.3, f"RangeRate_{k}": 1.0, f"Rcs_{k}": 0.0, f"Snr_{k}": 11.0}
        messages.append(frame(0x385, dbc.encode_message("NearDetections", values, strict=False), 1.0001 + number * 1e-4, fd=True))
    scan = feed(radar, messages)[0]
    np.testing.assert_allclose(np.sort(scan.range), np.sort(ranges)[:64], atol=0.0123)
    assert scan.ambiguity == pytest.approx(21.4, abs=0.002)
    assert health.truncated == 36


def test_no_number_in_a_float_signal_is_an_invalid_detection(tmp_path: Path) -> None:
    (tmp_path / "float.dbc").write_text(
        "BU_: R E\n\n"
        'BO_ 1 Head: 1 R\n SG_ Count : 0|8@1+ (1,0) [0|255] "" E\n\n'
        'BO_ 2 Point: 12 R\n SG_ R : 0|32@1- (1,0) [0|0] "m" E\n SG_ A : 32|32@1- (1,0) [0|0] "rad" E\n'
        ' SG_ V : 64|32@1- (1,0) [0|0] "m/s" E\n\n'
        "SIG_VALTYPE_ 2 R : 1;\nSIG_VALTYPE_ 2 A : 1;\nSIG_VALTYPE_ 2 V : 1;\n"
    )
    (tmp_path / "float.toml").write_text(
        'kind = "radar"\ndbc = "float.dbc"\n[header]\nmessage = "Head"\ncount = ["Count"]\n[detections]\nmessages = "Point"\n'
        'range = { signal = "R", unit = "m" }\nazimuth = { signal = "A", unit = "deg" }\n'
        'range_rate = { signal = "V", unit = "km/h", sign = -1 }\n'
    )
    path = tmp_path / "float.toml"
    health = SensorHealth()
    radar = RadarReader("radar", load_radar(path), Dbc(tmp_path / "float.dbc", path), 0, health)
    points = [(5.0, 90.0, 36.0), (math.nan, 0.0, 0.0), (5.0, math.inf, 0.0)]
    messages = [frame(1, b"\x03", 1.0)] + [frame(2, np.array(p, dtype="<f4").tobytes(), 1.001, fd=True) for p in points]
    assert_same(feed(radar, messages)[0], [(5.0, math.pi / 2, -10.0)], (1e-6, 1e-6, 1e-6))
    assert health.invalid == 2


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (('signal = "Range_{k}"', 'signal = "Distance_{k}"'), "has no signal 'Distance_1'"),
        (('message = "RadarHeader"', 'message = "Header"'), "has no message 'Header'"),
        (('unit = "m"', 'unit = "deg"'), "range is a length, but 'deg' is not"),
        (('unit = "m"', 'unit = "furlong"'), "'furlong' is not a known unit"),
        (("crc32.iso_hdlc", "crc32.wrong"), "'crc32.wrong' is not a known checksum"),
        (('page = "Page"', 'paeg = "Page"'), "unknown key 'paeg'; did you mean 'page'?"),
        (("per_frame = 8", "per_frame = 9"), "has no signal 'Range_9'"),
        (('signal = "Range_{k}"', 'signal = "Range_{x}"'), "'Range_{x}' is not a name"),
        (('cycle = "CycleCounter"', 'cycle = ""'), "header.cycle: an empty text found, expected a name"),
        (("max_detections = 64", "max_detections = 99999999999999999999"), "max_detections: 99999999999999999999 found, expected"),
        (('count = ["DetectionCount"]', ""), "needs header.count or frames"),
        (('azimuth = { signal = "Azimuth_{k}", unit = "rad" }', ""), "needs either range and azimuth, or x and y"),
    ],
)
def test_a_mistake_in_a_profile_is_one_sentence(tmp_path: Path, change: tuple[str, str], complaint: str) -> None:
    text = (DBC / "corner_radar.toml").read_text()
    assert change[0] in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(*change))
    with pytest.raises(EchogridError) as caught:
        RadarReader("radar", load_radar(path), Dbc(DBC / "corner_radar.dbc", path), 0, SensorHealth())
    assert str(caught.value).startswith(f"{path}: ")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("most", [3, 64])
def test_detections_that_are_chosen_lie_in_a_row(most: int) -> None:
    """As the loops want them that look at them: of a profile that the caller reads, too."""
    kept, _, _ = chosen(np.random.default_rng(2).uniform(1.0, 9.0, (4, 9)), most)
    assert kept.shape == (4, min(most, 9))
    assert all(row.flags.c_contiguous for row in kept)
