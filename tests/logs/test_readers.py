"""Readers of our own: frame for frame what python-can reads, and what was written where python-can reads another thing."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import can
import pytest
import zstandard
from can.io.player import MESSAGE_READERS
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import recorded

from echogrid.errors import EchogridError
from echogrid.logs.log import Log

pytestmark = pytest.mark.hypothesis
LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
START = 1600000000.0


@st.composite
def frames(draw: st.DrawFn, remote: bool = True, fd: bool = True, buses: int = 2) -> list[can.Message]:
    """In the order of their times, of whole microseconds."""
    messages, time = [], 0
    for _ in range(draw(st.integers(1, 12))):
        time += draw(st.integers(0, 2_000_000))
        extended, flexible = draw(st.booleans()), fd and draw(st.booleans())
        asks = remote and not flexible and draw(st.integers(0, 4)) == 0
        length = draw(st.sampled_from(LENGTHS if flexible else LENGTHS[:9]))
        messages.append(
            can.Message(
                timestamp=START + time / 1e6,
                arbitration_id=draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)),
                is_extended_id=extended,
                is_remote_frame=asks,
                channel=f"can{draw(st.integers(0, buses - 1))}",
                dlc=length,
                data=None if asks else draw(st.binary(min_size=length, max_size=length)),
                is_fd=flexible,
                is_rx=draw(st.booleans()),
                bitrate_switch=flexible and draw(st.booleans()),
                error_state_indicator=flexible and draw(st.booleans()),
            )
        )
    return messages


def key(message: Any, less: Sequence[str] = ()) -> dict[str, Any]:
    """All of a frame but its time; its channel as a file numbers it."""
    fields = {name: getattr(message, name) for name in can.Message.__slots__ if name not in ("__weakref__", "timestamp", *less)}
    fields["data"] = bytes(message.data)
    if isinstance(fields.get("channel"), str):
        fields["channel"] = recorded.number(message)
    return fields


def same(ours: Sequence[Any], theirs: Sequence[Any], less: Sequence[str] = (), within: float = 1e-6, dated: bool = True) -> None:
    assert [key(message, less) for message in ours] == [key(message, less) for message in theirs]
    zero = (0.0, 0.0) if dated else (ours[0].timestamp, theirs[0].timestamp)
    for our, their in zip(ours, theirs, strict=True):
        assert abs((our.timestamp - zero[0]) - (their.timestamp - zero[1])) <= within


def read(tmp_path: Path, name: str, data: bytes) -> list[can.Message]:
    path = tmp_path / name
    path.write_bytes(data)
    return list(Log(path))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("readers")


@given(frames())
@settings(max_examples=60)
def test_candump(folder: Path, messages: list[can.Message]) -> None:
    for message in messages:
        message.is_rx = True
    read_back = read(folder, "a.log", recorded.joined(recorded.candump(messages)))
    same(read_back, messages)
    same(read_back, list(can.CanutilsLogReader(folder / "a.log")), within=0)


@given(frames(), st.sampled_from(["absolute", "relative"]), st.sampled_from(["hex", "dec"]))
@settings(max_examples=80)
def test_asc(folder: Path, messages: list[can.Message], timestamps: str, base: str) -> None:
    read_back = read(folder, "a.asc", recorded.joined(recorded.asc(messages, timestamps, base)))
    same(read_back, messages, within=1e-3)  # the date has milliseconds
    same(read_back, messages, within=2e-6, dated=False)
    if timestamps == "absolute" and all(len(message.data) or not message.is_fd for message in messages):
        # python-can takes an empty frame of CAN FD for a remote one, and counts channels from 0
        theirs = list(can.ASCReader(folder / "a.asc"))
        for message in theirs:
            message.channel += 1
        same(read_back, theirs, within=2e-6, dated=False)


@given(frames())
@settings(max_examples=60)
def test_asc_of_python_can(folder: Path, messages: list[can.Message]) -> None:
    """Whose head has the time of writing, and the first frame's in the trigger block."""
    read_back = list(Log(recorded.by_python_can(folder / "p.asc", messages)))
    same(read_back, messages, within=2e-6, dated=False)
    assert abs(read_back[0].timestamp - messages[0].timestamp) < 1  # python-can writes 7 ms as .7


@given(frames(), st.sampled_from(["1.0", "1.1", "1.2", "1.3", "2.0", "2.1"]))
@settings(max_examples=120)
def test_trc(folder: Path, messages: list[can.Message], version: str) -> None:
    if version < "2":
        messages = [message for message in messages if not message.is_fd] or [can.Message(timestamp=START, channel="can0", data=b"1")]
    if version == "1.0":
        for message in messages:
            message.is_rx = True
    read_back = read(folder, "a.trc", recorded.joined(recorded.trc(messages, version)))
    no_bus = ("channel",) if version in ("1.0", "1.1", "2.0") else ()
    finest = {"1.0": 2.0, "2.0": 1e-3, "2.1": 1e-3}.get(version, 0.1) * 1e-3
    same(read_back, messages, no_bus, within=finest)
    if no_bus:
        assert {message.channel for message in read_back} == {None}
    if version in ("1.1", "1.3"):
        same(read_back, list(can.TRCReader(folder / "a.trc")), no_bus, within=2e-6)
    if version == "2.1":  # python-can puts the length's code into dlc, and takes it for the length of a remote frame
        theirs = list(can.TRCReader(folder / "a.trc"))
        same(read_back, theirs, ("dlc",), within=2e-6)


def test_trc_with_a_frame_older_than_the_first(folder: Path) -> None:
    """python-can writes an offset below zero for it: frames of two buses do not come in the order of their times."""
    messages = [can.Message(timestamp=START + late, channel=0, arbitration_id=1, data=b"1") for late in (0.5, 0.496, 0.51)]
    read_back = list(Log(recorded.by_python_can(folder / "p.trc", messages)))
    same(read_back, messages, ("channel",), within=2e-6)
    (folder / "undated.trc").write_text("1) -4.0 Rx 0100 1 01\n2) 0.0 Rx 0100 1 02\n")
    with pytest.raises(EchogridError, match="line 1: '1\\) -4.0 Rx"):
        list(Log(folder / "undated.trc"))


@given(frames(), st.integers(40, 2000), st.booleans(), st.sampled_from([1, 2]))
@settings(max_examples=120)
def test_blf(folder: Path, messages: list[can.Message], size: int, packed: bool, version: int) -> None:
    objects = [recorded.blf_frame(message, START, version) for message in messages]
    read_back = read(folder, "a.blf", recorded.joined(recorded.blf(objects, START, size, packed)))
    same(read_back, messages)
    theirs = list(can.BLFReader(folder / "a.blf"))
    for message in theirs:
        message.channel += 1
    same(read_back, theirs, within=0)


@given(frames())
@settings(max_examples=60)
def test_blf_of_all_kinds_of_frames(folder: Path, messages: list[can.Message]) -> None:
    """What CANoe writes: 1 or 86 for CAN, 101 for both, whose data ends where it ends; objects of other buses between them."""
    objects = []
    for count, message in enumerate(messages):
        kind = 101 if message.is_fd or (count % 3 == 0 and not message.is_remote_frame) else (1, 86)[count % 2]
        objects += [recorded.blf_frame(message, START, kind=kind), recorded.blf_object(4, bytes(24)), recorded.blf_object(57, b"LOBJ" * 5)]
    path = folder / "a.blf"
    path.write_bytes(recorded.joined(recorded.blf(objects, START)))
    log = Log(path)
    same(list(log), messages)
    assert log.account.others == {"bus statistics": len(messages), "objects of LIN": len(messages)}


@given(frames(buses=1))
@settings(max_examples=60)
def test_csv_of_python_can(folder: Path, messages: list[can.Message]) -> None:
    read_back = list(Log(recorded.by_python_can(folder / "a.csv", messages)))
    theirs = list(can.CSVReader(folder / "a.csv"))
    same(read_back, theirs, within=0)
    assert {message.channel for message in read_back} == {None}


@given(frames(remote=False))
@settings(max_examples=60)
def test_gvret(folder: Path, messages: list[can.Message]) -> None:
    read_back = read(folder, "a.csv", recorded.joined(recorded.gvret(messages)))
    same(read_back, messages, ("is_fd", "bitrate_switch", "error_state_indicator"))  # of which the format says nothing


@given(frames(), st.sampled_from("<>"), st.booleans())
@settings(max_examples=60)
def test_pcap(folder: Path, messages: list[can.Message], order: str, nanoseconds: bool) -> None:
    for message in messages:
        message.is_rx = True
    read_back = read(folder, "a.pcap", recorded.joined(recorded.pcap(messages, order, nanoseconds)))
    same(read_back, messages, ("channel",))
    assert {message.channel for message in read_back} == {None}


@given(frames(), st.sampled_from("<>"), st.booleans())
@settings(max_examples=60)
def test_pcapng(folder: Path, messages: list[can.Message], order: str, named: bool) -> None:
    for message in messages:
        message.is_rx = True
    read_back = read(folder, "a.pcapng", recorded.joined(recorded.pcapng(messages, order, named)))
    same(read_back, messages)


@pytest.mark.parametrize("name", ["a.log", "a.asc", "a.blf", "a.csv", "a.db"])
def test_packed_files_are_the_same(tmp_path: Path, name: str) -> None:
    messages = [can.Message(timestamp=START + n, arbitration_id=n, data=bytes([n]), channel="can0") for n in range(100)]
    plain = recorded.by_python_can(tmp_path / name, messages)
    expected = [(key(message), message.timestamp) for message in Log(plain)]
    data = plain.read_bytes()
    halves = data[: len(data) // 2], data[len(data) // 2 :]
    packed = {
        "one.gz": gzip.compress(data),
        "two.gz": b"".join(map(gzip.compress, halves)) + bytes(512),  # members one after the other, and zeros of a tape
        "one.zst": zstandard.compress(data),
        "two.zst": b"".join(map(zstandard.compress, halves)),
    }
    for ending, content in packed.items():
        path = tmp_path / (f"{ending[:3]}{plain.suffix}{ending[3:]}")
        path.write_bytes(content)
        assert [(key(message), message.timestamp) for message in Log(path)] == expected


@pytest.mark.parametrize("name", ["a.log", "a.asc", "a.blf", "a.csv"])
def test_the_demo_drive(tmp_path: Path, name: str) -> None:
    """Some thousand real frames, over many containers and groups of lines."""
    from tests.support.places import DEMO

    with gzip.open(DEMO / "can.log.gz", "rt") as file:
        lines = [next(file) for _ in range(6000)]
    (tmp_path / "first.log").write_text("".join(lines))
    path = recorded.by_python_can(tmp_path / name, list(can.CanutilsLogReader(tmp_path / "first.log")))
    same(list(Log(path)), list(MESSAGE_READERS[path.suffix](path)), ("channel",), within=1e-6, dated=name != "a.asc")
