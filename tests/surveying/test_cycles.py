"""How cycles are put together, counted off frames, against the profiles that were written by hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import can
import fastcrc
import pytest
from tests.judging.trial import winding
from tests.support import frames
from tests.support.paged import paged_dbc
from tests.support.places import DBC

from echogrid.can import dbc_file
from echogrid.can.profile import RadarProfile, load_radar
from echogrid.surveying.counting import checksum_of, counter_of
from echogrid.surveying.cycles import Shape, shape_of
from echogrid.surveying.groups import groups_of
from echogrid.surveying.heard import Channel, Heard
from echogrid.surveying.proposal import propose
from echogrid.surveying.senders import Source
from echogrid.surveying.survey import survey


def heard(messages: Sequence[can.Message]) -> Channel:
    all_of_them = Heard()
    for message in messages:
        all_of_them.add(message)
    (channel,) = all_of_them.channels
    return channel


def shape(name: str, channel: Channel, shift: int = 0) -> Shape | None:
    database = dbc_file.parse((DBC / f"{name}.dbc").read_bytes())
    (group,) = groups_of(database)
    return shape_of(group, channel, shift, [m for m in database.messages if m not in group.messages])


def assert_same_sum(found: Shape, wanted: RadarProfile) -> None:
    """The same place, and the same algorithm by whatever of its names."""
    assert found.crc is not None
    assert wanted.crc is not None
    assert found.crc[:2] == (wanted.crc.message, wanted.crc.signal)
    one, other = (getattr(getattr(fastcrc, name.split(".")[0]), name.split(".")[1]) for name in (found.crc[2], wanted.crc.algorithm))
    assert all(one(data) == other(data) for data in (b"123456789", b"", b"\0\xff"))


@pytest.mark.parametrize("shift", [0, 16, 48])
def test_pages_after_a_header_with_a_checksum_over_all(shift: int) -> None:
    found, wanted = shape("corner_radar", heard(winding(8.0).messages), shift), load_radar(DBC / "corner_radar.toml")
    assert found is not None
    assert wanted.header is not None
    assert found.header is not None
    assert found.header.name == wanted.header.message
    assert (found.count, found.cycle) == (wanted.header.count, wanted.header.cycle)
    assert (found.page, found.detections_cycle, found.cycle_bits) == (wanted.detections.page, wanted.detections.cycle, None)
    assert_same_sum(found, wanted)
    assert (found.ends_with, found.frames) == (None, None)


def test_pages_of_a_multiplexor_that_number_detections_through() -> None:
    database = dbc_file.parse(paged_dbc(pages=8).encode())
    (group,), header = groups_of(database), database.named("RadarHeader")
    found = shape_of(group, heard(winding(8.0).messages), 0, header)
    assert (group.per_frame, group.in_a_frame) == (64, 8)
    assert found is not None
    assert (found.count, found.page, found.frames) == (("DetectionCount",), "Page", None)


def test_frames_that_are_there_and_make_no_cycle_are_told(tmp_path: Path) -> None:
    """Without headers; and where there are none at all."""
    dbc = tmp_path / "paged.dbc"
    dbc.write_text(paged_dbc(pages=8))
    pages = [m for cycle in range(9) for m in frames.radar_cycle([(5.0, 0.1, -1.0)] * 30, cycle, 100.0)[1:]]
    told = []
    for messages in (pages, [frames.yaw_rate(0.1, 1, 100.0)]):
        found = survey([heard(messages)], [Source(dbc, dbc_file.parse(dbc.read_bytes()))])
        told += [line for line in propose(found, tmp_path / "drive.log", tmp_path, "new").missing if line.startswith("radars: ")]
    begin = "radars: the DBC has signals like detections with range, azimuth and range rate"
    end = "; a skeleton of the profile is written"
    assert told == [
        f"{begin}, and the recording has frames of 'RadarDetections', but no whole scans can be made of them{end}",
        f"{begin}, but the recording has no frames that fit{end}",
    ]


def test_a_frame_for_each_detection() -> None:
    messages = [
        message
        for cycle in range(40)
        for message in frames.classic_cycle([(5.0 + k, 0.1 * k - 1, -3.0 + k) for k in range(3 + cycle % 7)], cycle, 100 + 0.05 * cycle)
    ]
    found, wanted = shape("corner_radar_classic", heard(messages)), load_radar(DBC / "corner_radar_classic.toml")
    assert found is not None
    assert wanted.header is not None
    assert (found.count, found.cycle) == (wanted.header.count, wanted.header.cycle)
    assert found.detections_cycle == wanted.detections.cycle
    assert_same_sum(found, wanted)


def test_lost_frames_change_nothing() -> None:
    whole = winding(8.0).messages
    found = shape("corner_radar", heard([m for n, m in enumerate(whole) if n % 23]))
    assert found is not None
    assert found.agrees < 0.95
    assert (found.count, found.page, found.cycle) == (("DetectionCount",), "Page", "CycleCounter")


def test_counters_and_checksums_of_single_frames() -> None:
    database = dbc_file.parse((DBC / "vehicle_motion.dbc").read_bytes())
    (message,) = database.named("YawRate")
    payloads = [bytes(m.data) for m in winding(8.0).messages if m.arbitration_id == message.frame_id]
    counter, checksum = counter_of(message, payloads), checksum_of(message, payloads)
    assert counter is not None
    assert counter.name == "Counter"
    assert checksum is not None
    assert (checksum[0].name, checksum[1]) == ("Crc", "crc8.sae_j1850")
    assert checksum_of(message, [payload[:-1] + bytes([payload[-1] ^ 1]) for payload in payloads]) is None
