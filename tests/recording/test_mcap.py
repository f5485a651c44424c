"""MCAP recordings: the frames come back as they were, others read what was published, and no file does harm."""

from __future__ import annotations

import signal
import struct
import subprocess
import sys
import textwrap
import threading
import tracemalloc
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

import can
import lz4.frame
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
from tests.support import mcap_files
from tests.support.frames import FRAMES
from tests.support.waiting import PATIENCE, until

from echogrid.commands.run import named_by_time
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.logs.formats import mcap_log
from echogrid.logs.log import Log
from echogrid.recording import mcap_recorder, mcap_writer
from echogrid.recording.mcap_recorder import FRAME_BYTES, McapRecorder
from echogrid.recording.mcap_writer import McapWriter
from echogrid.topics.can_frame import LONGEST_NAME, encode_frame
from echogrid.topics.poses import Odometry, encode_odometry
from echogrid.topics.ros_definitions import CAN_FRAME, definition
from echogrid.topics.topic import FULL, META, ODOMETRY, Message

Attributes = list[tuple[object, ...]]


def attributes(messages: Sequence[can.Message]) -> Attributes:
    return [tuple(getattr(message, name) for name in can.Message.__slots__ if name != "__weakref__") for message in messages]


def odometry(n: int) -> Message:
    stamp_ns = 1732547000_000_000_000 + n
    payload = encode_odometry(Odometry(stamp_ns, "odom", "base", SE2(n, 0.0, 0.0), 1.0, 0.1))
    return Message(ODOMETRY, payload, stamp_ns, 1, 0)


def written(path: Path, frames: Sequence[can.Message]) -> Path:
    with McapWriter(path) as writer:
        for frame in frames:
            writer.frame(f"bus {frame.channel}", frame)
    return path


def test_frames_come_back_in_their_order_as_they_were(tmp_path: Path) -> None:
    log = Log(written(tmp_path / "a.mcap", FRAMES))
    assert attributes(list(log)) == attributes(FRAMES)
    assert (log.messages, log.progress) == (len(FRAMES), 1.0)


def test_others_find_every_message_by_its_index_and_read_it(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    published = [odometry(n) for n in range(50)]
    with McapWriter(path) as writer:
        for message, frame in zip(published, FRAMES * 10, strict=False):
            writer.frame("front", frame)
            writer.put(message)
            writer.put(Message(FULL, b"", message.stamp_ns, 1, 0))
    rows = mcap_files.read(path)
    odometries = [row for row in rows if row.topic == "/echogrid/odom"]
    assert [row.data for row in odometries] == [message.payload for message in published]
    assert [(row.log_time, row.publish_time) for row in odometries] == [(message.stamp_ns, message.stamp_ns) for message in published]
    assert [row.message.pose.pose.position.x for row in odometries] == list(range(50))
    assert [row.sequence for row in odometries] == list(range(1, 51))
    assert {row.topic for row in rows} == {"/echogrid/odom", "/can/front"}
    assert all(row.message.header.stamp.sec * 10**9 + row.message.header.stamp.nanosec == row.log_time for row in rows)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 100
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 0


@pytest.mark.parametrize(
    "options",
    [{"compression": CompressionType.LZ4}, {"compression": CompressionType.NONE}, {"use_chunking": False}, {"enable_crcs": False}],
)
def test_others_may_write_it_otherwise(tmp_path: Path, options: dict[str, object]) -> None:
    """Merged or repacked by MCAP's own tools, with other channels in between."""
    path = tmp_path / "a.mcap"
    writer = Writer(str(path), **options)  # type: ignore[arg-type]  # of several types
    writer.start()
    other = writer.register_channel("/other", "json", 0)
    channel = writer.register_channel("/can/a", "cdr", writer.register_schema(CAN_FRAME, "ros2msg", definition(CAN_FRAME).encode()))
    for frame in FRAMES:
        writer.add_message(other, 0, b"{}", 0)
        writer.add_message(channel, 0, encode_frame("a", frame), 0)
    writer.add_attachment(0, 0, "notes", "text/plain", bytes(1000))
    writer.finish()
    back = list(Log(path))
    for frame in FRAMES:
        back[FRAMES.index(frame)].channel = frame.channel  # which only our own metadata tells
    assert attributes(back) == attributes(FRAMES)


def test_a_torn_file_gives_what_it_holds_and_then_one_sentence(tmp_path: Path) -> None:
    whole = tmp_path / "a.mcap"
    with McapWriter(whole) as writer:
        for _ in range(10):
            for frame in FRAMES:
                writer.frame("a", frame)
            writer.flush()
        end = writer.size
    data, found = whole.read_bytes(), set()
    for length in range(0, end, 97):
        path = tmp_path / "torn.mcap"
        path.write_bytes(data[:length])
        got: list[can.Message] = []
        with pytest.raises(EchogridError, match=r"torn.mcap: cannot be read beyond message \d+: it ") as caught:
            got.extend(iter(Log(path)))
        assert attributes(got) == attributes(FRAMES * 10)[: len(got)]
        assert len(got) % len(FRAMES) == 0
        found.add(len(got))
        assert "\n" not in str(caught.value)
    assert found == {n * len(FRAMES) for n in range(11)}
    path.write_bytes(data[:-20])  # of the index, which nobody needs to replay it
    assert attributes(list(Log(path))) == attributes(FRAMES * 10)


def test_a_service_that_is_killed_leaves_all_but_the_last_moment(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    code = f"""
        import os, signal, threading, time
        from pathlib import Path
        from echogrid.recording import mcap_recorder
        from tests.support.frames import FRAMES
        mcap_recorder.FLUSH_PERIOD = 0.1
        recorder = mcap_recorder.McapRecorder(Path({str(path)!r}))
        threading.Thread(target=recorder.run, args=(threading.Event(),), daemon=True).start()
        for n in range(2):
            for frame in FRAMES:
                recorder.frame("a", frame)
            size = recorder.recording.mib
            while recorder.recording.frames < (n + 1) * len(FRAMES) or recorder.recording.mib == size:
                time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGKILL)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], timeout=PATIENCE, check=False)
    assert done.returncode == -signal.SIGKILL
    got: list[can.Message] = []
    with pytest.raises(EchogridError, match="it was not closed, its last part may be missing"):
        got.extend(iter(Log(path)))
    assert attributes(got) == attributes(FRAMES * 2)


def test_a_service_that_is_killed_in_its_first_moment_leaves_an_empty_recording(tmp_path: Path) -> None:
    recorder, stop = McapRecorder(tmp_path / "a.mcap"), threading.Event()
    running = threading.Thread(target=recorder.run, args=(stop,))
    running.start()
    try:
        until(lambda: (tmp_path / "a.mcap").stat().st_size > 0)
        with pytest.raises(EchogridError, match="beyond message 0: it was not closed, its last part may be missing"):
            next(iter(Log(tmp_path / "a.mcap")))
    finally:
        stop.set()
        running.join()
        recorder.close()


def test_a_full_disk_ends_the_recording_and_says_so(tmp_path: Path) -> None:
    """The operating system refuses to let the file grow; all that was written before can be read."""
    path = tmp_path / "a.mcap"
    code = f"""
        import dataclasses, os, resource
        from pathlib import Path
        from echogrid.recording import mcap_recorder
        from echogrid.topics.can_frame import encode_frame
        from tests.support.frames import FRAMES
        import can
        mcap_recorder.FLUSH_PERIOD = 0
        recorder = mcap_recorder.McapRecorder(Path({str(path)!r}))
        resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
        for n in range(50):
            for frame in FRAMES:
                frame.data = bytearray(os.urandom(len(frame.data)))
                recorder.frame("a", frame)
            recorder._write()
        recorder.close()
        print(recorder.recording.state, recorder.recording.reason, recorder.recording.left_out)
    """
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.stdout.strip() == "failed File too large 0"
    assert done.stderr.strip() == f"{path}: the recording ends here: File too large; mapping continues"
    got: list[can.Message] = []
    with pytest.raises(EchogridError, match="its last part"):
        got.extend(iter(Log(path)))
    assert len(got) > len(FRAMES)
    assert [frame.arbitration_id for frame in got] == [frame.arbitration_id for frame in FRAMES * 50][: len(got)]


def test_a_queue_that_is_full_leaves_out_and_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Published messages first: frames find room in the second half of the queue too."""
    monkeypatch.setattr(mcap_recorder, "MOST_WAITING", 10 * FRAME_BYTES)
    recorder = McapRecorder(tmp_path / "a.mcap")
    message = Message(META, b"{}".ljust(FRAME_BYTES), 1, 1, 0)
    for _ in range(7):
        recorder.put(message)
    assert recorder.recording.left_out == 2
    for frame in FRAMES[:7]:
        recorder.frame("a", frame)
    assert recorder.recording.left_out == 4
    stop = threading.Event()
    stop.set()
    recorder.run(stop)
    recorder.frame("a", can.Message(arbitration_id=-1))  # no frame, whatever a log says
    recorder.close()
    recording = recorder.recording
    assert (recording.state, recording.messages, recording.frames, recording.left_out) == ("closed", 5, 5, 5)
    assert recording.mib > 0
    assert attributes(list(Log(tmp_path / "a.mcap"))) == attributes(FRAMES[:5])


def test_a_log_with_ever_new_channels_is_recorded_as_far_as_channels_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_writer, "MOST_BUSES", 3)
    names = ["a", "b" * (LONGEST_NAME + 1), "c", "d", "e", "a"]
    taken = []
    with McapWriter(tmp_path / "a.mcap") as writer:
        for name in names:
            with suppress(ValueError):
                writer.frame(name, can.Message(channel=name))
                taken.append(name)
    assert taken == ["a", "c", "d", "a"]
    assert [frame.channel for frame in Log(tmp_path / "a.mcap")] == taken


def test_in_a_folder_each_start_has_a_recording_of_its_own(tmp_path: Path) -> None:
    """However fast they follow, and also where the clock begins each time at the same."""
    for _ in range(3):
        named_by_time(tmp_path, 1_767_225_600.0).touch()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "20260101T000000Z-2.mcap",
        "20260101T000000Z-3.mcap",
        "20260101T000000Z.mcap",
    ]


def test_no_file_is_replaced_and_what_cannot_be_made_is_said(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", FRAMES)
    for where, why in (
        (path, "exists already, and a recording never replaces a file"),
        (path / "b.mcap", "cannot be written: Not a directory"),
    ):
        with pytest.raises(EchogridError, match=f"{where}: {why}"):
            McapRecorder(where)


def other_mcap(path: Path, channels: Sequence[tuple[str, str, str, dict[str, str]]], data: bytes = b"") -> Path:
    """Channels of a topic, a type, its definition and metadata, with one message each."""
    writer = Writer(str(path))
    writer.start()
    for topic, kind, text, metadata in channels:
        channel = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", text.encode()), metadata)
        writer.add_message(channel, 1, data, 1)
    writer.finish()
    return path


OURS = definition(CAN_FRAME)


@pytest.mark.parametrize(
    ("channels", "complaint"),
    [
        ([], "holds no CAN frames: its channels are none; expected one of type echogrid_msgs/msg/CanFrame, as "),
        (
            [("/a", "x/msg/Y", "", {}), ("/b", "x/msg/Z", "", {})],
            "holds no CAN frames: its channels are /a (x/msg/Y), /b (x/msg/Z); expected",
        ),
        ([(f"/{n}", "x/msg/Y", "", {}) for n in range(20)], "/7 (x/msg/Y), ...; expected"),
        ([("/can/a", CAN_FRAME, "uint8 x\n", {})], "the frames on /can/a are in another format than this version writes"),
        ([("/can/a", CAN_FRAME, OURS, {})], "cannot be read beyond message 0: a frame's message ends after 0 bytes"),
        ([("/can/a", CAN_FRAME, OURS, {"channel": "[1]"})], "a channel's name in python-can is not a name"),
        ([("/can/a", CAN_FRAME, OURS, {"channel": "no JSON"})], "JSONDecodeError"),
    ],
)
def test_an_mcap_file_without_our_frames_is_one_sentence(
    tmp_path: Path, channels: list[tuple[str, str, str, dict[str, str]]], complaint: str
) -> None:
    path = other_mcap(tmp_path / "a.mcap", channels)
    with pytest.raises(EchogridError) as caught:
        list(Log(path))
    assert str(caught.value).startswith(f"{path}: ")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def chunk(compression: str, data: bytes, size: int) -> bytes:
    builder = RecordBuilder()
    Chunk(compression, data, 0, 0, 0, size).write(builder)
    return builder.end()


EMPTY_RECORDS = struct.pack("<BQ", 0x80, 0) * (1 << 16)
HOSTILE: dict[str, Callable[[], bytes]] = {
    "a record of 2^63 bytes": lambda: struct.pack("<BQ", 5, 1 << 63),
    "a chunk of 2^63 bytes": lambda: chunk("zstd", b"", 1 << 63),
    "zstd that unpacks to more than it says": lambda: chunk("zstd", zstandard.compress(bytes(40 << 20)), 100),
    "zstd that says it unpacks to a terabyte": lambda: chunk("zstd", b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 1 << 40), 100),
    "lz4 that unpacks to more than it says": lambda: chunk("lz4", lz4.frame.compress(bytes(40 << 20)), 100),
    "chunks that unpack to a thousand times the file": lambda: chunk("zstd", zstandard.compress(EMPTY_RECORDS), len(EMPTY_RECORDS)) * 20,
    "strings longer than their record": lambda: struct.pack("<BQHHI", 4, 8, 1, 1, 0xFFFFFFFF),
    "metadata without an end": lambda: struct.pack("<BQHHIII", 4, 16, 1, 1, 0, 0, 0xFFFFFFFF),
    "an unknown packing": lambda: chunk("x" * 10000, b"", 0),
    "no record": lambda: b"\0" * 1000,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_small_files_do_not_unpack_to_large_memory(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_log, "MOST_BYTES", 1 << 20)
    path = tmp_path / "a.mcap"
    path.write_bytes(MCAP0_MAGIC + HOSTILE[name]())
    tracemalloc.start()
    try:
        with pytest.raises(EchogridError, match="a.mcap: cannot be read beyond message 0: ") as caught:
            list(Log(path))
        assert tracemalloc.get_traced_memory()[1] < 10 << 20
    finally:
        tracemalloc.stop()
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("action", ["list(Log(Path('a.mcap')))", "McapRecorder(Path('b.mcap'))"])
def test_without_the_extra_the_sentence_names_it(tmp_path: Path, action: str) -> None:
    (tmp_path / "a.mcap").write_bytes(MCAP0_MAGIC)
    code = f"""
        import sys
        sys.modules["mcap"] = None
        from pathlib import Path
        from echogrid.errors import EchogridError
        from echogrid.logs.log import Log
        from echogrid.recording.mcap_recorder import McapRecorder
        try:
            {action}
        except EchogridError as error:
            print(error)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE, check=True
    )
    assert done.stdout.count("\n") == 1
    assert "pip install mcap" in done.stdout
