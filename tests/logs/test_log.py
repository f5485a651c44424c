"""Recordings: every format that python-can writes reads back the same, and garbage is one sentence."""

from __future__ import annotations

import gzip
import os
import sqlite3
import struct
import threading
import tracemalloc
import zlib
from contextlib import closing
from pathlib import Path

import can
import pytest
import zstandard
from tests.support.frames import radar_cycle, wheel_speeds

from echogrid.can.signals import bus_of
from echogrid.config.tables import Bus
from echogrid.errors import EchogridError
from echogrid.logs.formats.stream import LONGEST_LINE
from echogrid.logs.log import Log

MESSAGES = [wheel_speeds(3.0, n, 1000.0 + n / 100) for n in range(20)]
FD = radar_cycle([(5.0, 0.1, -1.0)] * 20, 1, 1000.5)


def write(path: Path, messages: list[can.Message]) -> Path:
    with can.Logger(path) as logger:
        for message in messages:
            logger.on_message_received(message)
    return path


@pytest.mark.parametrize("name", ["a.log", "a.log.gz", "a.blf", "a.asc", "a.asc.gz", "a.csv", "a.db", "a.trc"])
def test_what_python_can_writes_reads_back(tmp_path: Path, name: str) -> None:
    messages = MESSAGES if name == "a.trc" else MESSAGES + FD  # python-can's TRC writer has no CAN FD
    log = Log(write(tmp_path / name, messages))
    back = list(log)
    assert [(m.arbitration_id, bytes(m.data)) for m in back] == [(m.arbitration_id, bytes(m.data)) for m in messages]
    first, last = back[0].timestamp, back[-1].timestamp
    assert last - first == pytest.approx(messages[-1].timestamp - messages[0].timestamp, abs=2e-3)
    assert log.messages == len(messages)
    assert log.progress == 1.0


def test_progress_grows(tmp_path: Path) -> None:
    log = Log(write(tmp_path / "a.log", MESSAGES * 4000))
    seen = [log.progress for _ in log]
    assert seen == sorted(seen)
    assert seen[0] == 0
    assert 0.8 < seen[-1] < 1  # the last frames were read, but the map is not made of them yet
    assert log.progress == 1


def test_a_log_that_is_not_read_in_the_end_leaves_no_file_open(tmp_path: Path) -> None:
    """As where what is to be written is refused after it was named; what comes through a pipe comes once."""
    path = write(tmp_path / "a.log", MESSAGES)
    before = os.listdir("/proc/self/fd")  # noqa: PTH208
    log = Log(path)
    assert os.listdir("/proc/self/fd") == before  # noqa: PTH208
    assert len(list(log)) == len(MESSAGES)
    pipe = tmp_path / "pipe.log"
    os.mkfifo(pipe)
    writing = threading.Thread(target=lambda: pipe.write_bytes(path.read_bytes()))
    writing.start()
    assert len(list(Log(pipe))) == len(MESSAGES)
    writing.join()


def test_a_torn_log_gives_what_it_holds_and_then_one_sentence(tmp_path: Path) -> None:
    whole = write(tmp_path / "a.log.gz", MESSAGES * 100).read_bytes()
    path = tmp_path / "torn.log.gz"
    path.write_bytes(whole[: len(whole) // 2])
    log, got = Log(path), []
    with pytest.raises(EchogridError, match=r"torn.log.gz: cannot be read beyond message \d+: "):
        got.extend(iter(log))
    assert log.messages > 100


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        (
            "a.log",
            b"\x00\xff\xfe garbage \x80 here\n" * 10,
            "holds no CAN message; 10 of its parts could not be understood, the first is line 1: '",
        ),
        ("a.log", b"(1.0) can0 123#00\nand then somebody typed this\n", "the first is line 2: 'and then somebody typed this'"),
        ("a.blf", b"LOGGnot really", "it is no BLF file: it begins otherwise"),
        ("a.blf", b"", "it is no BLF file: it begins otherwise"),
        ("a.db", b"no database", "cannot be read beyond message 0"),
        ("a.log", b"", "holds no CAN message"),
        ("a.log.gz", gzip.compress(b"", mtime=0), "holds no CAN message"),
        ("a.log.gz", b"not zipped", "cannot be read beyond message 0: its packed data is not sound"),
        ("a.log.zst", b"not zipped", "cannot be read beyond message 0: its packed data is not sound"),
        ("a.csv", b"a;b;c\n1;2;3\n", "its columns are 'a;b;c', expected python-can's (timestamp,"),
        ("a.pcap", b"a;b;c\n1;2;3\n" * 9, "it is no capture: it begins otherwise"),
        ("a.trc", b";$FILEVERSION=3.0\n 1) 1.0 Rx 0100 8 00\n", "line 2: "),
    ],
)
def test_garbage_is_one_sentence(tmp_path: Path, name: str, content: bytes, complaint: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(EchogridError) as caught:
        list(Log(path))
    assert complaint in str(caught.value)
    assert str(path) in str(caught.value)


def blf_file(path: Path, packed: bytes, size: int | None = None) -> Path:
    """A BLF file as python-can begins it, with one container of deflated data; `size`: what the container says it has."""
    head = write(path, MESSAGES).read_bytes()
    body = struct.pack("<H6xI4x", 2, len(packed)) + packed
    container = struct.pack("<4sHHII", b"LOBJ", 16, 1, 16 + len(body) if size is None else size, 10) + body
    path.write_bytes(head[: struct.unpack_from("<I", head, 4)[0]] + container)
    return path


def peak_of_reading(path: Path) -> int:
    """The most bytes that Python held while the file was read, to an error's end."""
    tracemalloc.start()
    try:
        with pytest.raises(EchogridError) as caught:
            list(Log(path))
        assert str(caught.value).startswith(f"{path}: holds no CAN message; ")
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_small_files_do_not_unpack_to_large_memory(tmp_path: Path) -> None:
    """A line without an end, a container and an object that say they hold gigabytes."""
    for name, pack in (("a.log.gz", lambda data: gzip.compress(data, 1)), ("a.log.zst", zstandard.compress)):
        line = tmp_path / name
        line.write_bytes(pack(bytes(LONGEST_LINE)) * 2000)
        assert peak_of_reading(line) < 100 * LONGEST_LINE
    assert peak_of_reading(blf_file(tmp_path / "a.blf", zlib.compress(bytes(20 << 20), 1))) < 10 << 20
    assert peak_of_reading(blf_file(tmp_path / "b.blf", b"", size=0xFFFFFFFF)) < 10 << 20


def test_an_object_that_ends_before_it_begins_is_not_read_for_ever(tmp_path: Path) -> None:
    for size in (0, 15):
        empty = struct.pack("<4sHHII", b"LOBJ", 32, 1, size, 1) + bytes(64)
        with pytest.raises(EchogridError, match="of its containers"):
            list(Log(blf_file(tmp_path / "a.blf", zlib.compress(empty))))
        with pytest.raises(EchogridError, match="bytes follow its last whole object"):
            list(Log(blf_file(tmp_path / "a.blf", zlib.compress(empty), size=size)))


@pytest.mark.parametrize(
    ("schema", "complaint"),
    [
        (
            "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT i, i, 0, 0, 0, 1, x'00' FROM n",
            "table",
        ),
        ("CREATE TABLE messages (a, b, c, d, e, f, data AS (zeroblob(1000000000)))", "no plain table"),
        ("CREATE TABLE messages (a, b, c, d, e, f, g); INSERT INTO messages VALUES (1.0, 'x', 0, 0, 0, 1, x'00')", "message's id is 'x'"),
        ("CREATE TABLE messages (a, b, c, d, e, f, g); INSERT INTO messages VALUES ('x', 1, 0, 0, 0, 1, x'00')", "message's time is 'x'"),
        ("CREATE TABLE messages (a, b, c, d, e, f, g); INSERT INTO messages VALUES (9e99, 1, 0, 0, 0, 1, x'00')", "message's time is 9e"),
    ],
)
def test_a_database_that_is_no_recording(tmp_path: Path, schema: str, complaint: str) -> None:
    path = tmp_path / "a.db"
    with closing(sqlite3.connect(path)) as database:
        database.executescript(schema)
    with pytest.raises(EchogridError, match=complaint):
        list(Log(path))


@pytest.mark.parametrize("time", ["1e999", "nan", "9999999999"])
def test_no_message_is_of_a_time_that_cannot_be(tmp_path: Path, time: str) -> None:
    path = tmp_path / "a.log"
    path.write_text(f"(1.0) can0 123#00\n({time}) can0 123#00\n")
    log, got = Log(path), []
    with pytest.raises(EchogridError, match=r"the first is line 2: "):
        got.extend(iter(log))
    assert len(got) == 1


def test_unknown_endings_and_missing_files_are_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(EchogridError, match=r"is a folder, expected a recording, such as .*can\.log$"):
        Log(tmp_path)
    (tmp_path / "drive_0.mcap").touch()  # as `--record drive` makes it
    with pytest.raises(EchogridError, match=r"is a folder, expected a recording, such as .*drive_0\.mcap$"):
        Log(tmp_path)
    with pytest.raises(EchogridError, match="is not a known log format, expected one of .asc"):
        Log(tmp_path / "a.xyz")
    with pytest.raises(EchogridError, match="No such file"):
        Log(tmp_path / "a.log")


@pytest.mark.parametrize(
    ("channel", "bus", "belongs"),
    [
        ("can1", Bus(name="b", channel="can1"), True),
        ("can0", Bus(name="b", channel="can1"), False),
        (2, Bus(name="b", channel="can1"), True),  # files that number channels begin with 1
        (1, Bus(name="b", channel="can1"), False),
        (1, Bus(name="b", channel="can0"), True),
        (0, Bus(name="b", channel="can0"), False),
        (1, Bus(name="b", channel="PCAN_USBBUS1"), True),
        (1, Bus(name="b", channel="1"), False),  # of an interface that numbers from 0
        (4, Bus(name="b", channel="can1", log_channel=4), True),
        (4, Bus(name="b", channel="can1", log_channel="4"), True),
        (1, Bus(name="b", channel="can1", log_channel=4), False),
        (1, Bus(name="b", channel="can7", log_channel="can0"), True),
        ("can0", Bus(name="b", channel="can7", log_channel=0), True),
        ("vcan7", Bus(name="b", channel="can1", log_channel="vcan7"), True),
        (None, Bus(name="b", channel="can1"), True),
    ],
)
def test_which_bus_a_logged_message_belongs_to(channel: str | int | None, bus: Bus, belongs: bool) -> None:
    assert (bus_of(can.Message(channel=channel), (bus,)) == "b") == belongs


def test_without_a_channel_two_buses_cannot_be_told_apart() -> None:
    assert bus_of(can.Message(channel=None), (Bus(name="a"), Bus(name="b", channel="can1"))) is None
