"""Nothing is lost without a word: files torn anywhere, junk anywhere, and frames in = frames told."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.support import recorded
from tests.support.frames import radar_cycle, wheel_speeds

from echogrid.errors import EchogridError
from echogrid.logs.log import Log

pytestmark = pytest.mark.hypothesis
START = 1600000000.0
MOTION = [wheel_speeds(3.0, n, START + n / 100) for n in range(12)]
BOTH = MOTION + radar_cycle([(5.0, 0.1, -1.0)] * 9, 1, START + 0.13)
OBJECTS = [recorded.blf_frame(message, START) for message in BOTH]
FILES: dict[str, Callable[[], list[bytes]]] = {  # as pieces between which a sound file may be cut or filled
    "a.log": lambda: [line.encode() + b"\n" for line in recorded.candump(BOTH)],
    "a.asc": lambda: [line.encode() + b"\n" for line in recorded.asc(BOTH)],
    "a.trc": lambda: [line.encode() + b"\n" for line in recorded.trc(BOTH)],
    "v11.trc": lambda: [line.encode() + b"\r\n" for line in recorded.trc(MOTION, "1.1")],
    "g.csv": lambda: [line.encode() + b"\n" for line in recorded.gvret(BOTH)],
    "p.csv": lambda: [line.encode() + b"\r\n" for line in recorded.python_can_csv(BOTH)],
    "a.blf": lambda: recorded.blf(OBJECTS, START, 300),
    "stored.blf": lambda: recorded.blf(OBJECTS, START, 300, packed=False),
    "plain.blf": lambda: [recorded.blf([], START)[0], *OBJECTS],  # without containers
    "a.pcap": lambda: recorded.pcap(BOTH),
    "a.pcapng": lambda: recorded.pcapng(BOTH),
}


def read(path: Path, data: bytes) -> tuple[Log, str]:
    """A log that has been read, and what was said at its end."""
    path.write_bytes(data)
    log, said = Log(path), ""
    try:
        list(log)
    except EchogridError as error:
        said = str(error)
    assert log.messages == log.times.frames
    return log, said


def count_and_words(path: Path, data: bytes) -> tuple[int, str]:
    """How many frames are read, and what is said at the end."""
    log, said = read(path, data)
    return log.messages, said


def total(name: str) -> int:
    return len(MOTION) if name == "v11.trc" else len(BOTH)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("losses")


@pytest.mark.parametrize("name", FILES)
def test_the_whole_file_is_said_to_be_whole(folder: Path, name: str) -> None:
    assert count_and_words(folder / name, b"".join(FILES[name]())) == (total(name), "")


@pytest.mark.parametrize("name", ["a.log", "a.asc", "a.trc", "g.csv", "p.csv", "a.blf", "a.pcap", "a.pcapng", "a.db"])
def test_times_that_no_stamp_can_hold_are_said_to_be_to_blame(tmp_path: Path, name: str) -> None:
    """A clock of the year 2042, or milliseconds where seconds are expected."""
    frames = [wheel_speeds(3.0, n, 2**31 + 1e8 + n / 100) for n in range(12)]
    writers = {".log": recorded.candump, ".asc": recorded.asc, ".trc": recorded.trc, ".pcap": recorded.pcap, ".pcapng": recorded.pcapng}
    writers |= {"g.csv": recorded.gvret, "p.csv": recorded.python_can_csv}
    path = tmp_path / name
    if name == "a.db":
        said = read(path, recorded.by_python_can(tmp_path / "b.db", frames).read_bytes())[1]
    elif name == "a.blf":
        start = frames[0].timestamp
        said = read(path, recorded.joined(recorded.blf([recorded.blf_frame(frame, start) for frame in frames], start)))[1]
    else:
        said = read(path, recorded.joined((writers.get(path.suffix) or writers[name])(frames)))[1]
    assert "s since 1970 is after January 2038, beyond what ROS's stamps hold" in said
    assert "2247483648." in said


@pytest.mark.parametrize("name", FILES)
def test_a_file_torn_anywhere_gives_the_frames_before_and_says_so(folder: Path, name: str) -> None:
    """Text that is torn between two lines is whole; torn within its last line it says that line, or that it has no end."""
    pieces = FILES[name]()
    data, before = b"".join(pieces), -1
    for length in range(0, len(data), 1 if len(data) < 3000 else 7):
        path = folder / name
        frames, said = count_and_words(path, data[:length])
        assert frames >= before - 1, length  # a last line may be read though it is torn, and not any more when it is longer
        before = frames
        if said:
            continue
        assert frames > 0
        if not name.endswith((".log", ".asc", ".trc", ".csv", ".pcap", ".pcapng")) and name != "plain.blf":
            raise AssertionError(f"nothing was said of {length} of {len(data)} bytes")
        log, _ = read(path, data[:length])
        at_a_piece = any(length == sum(map(len, pieces[:count])) for count in range(len(pieces)))
        assert at_a_piece or log.account.notes or data[length : length + 1] in (b"\n", b"\r") or data[:length].endswith(b"\r"), length


def test_a_blf_cut_between_containers_says_what_its_head_promised(folder: Path) -> None:
    head, *containers = FILES["a.blf"]()
    for count in range(1, len(containers)):
        frames, said = count_and_words(folder / "cut.blf", head + b"".join(containers[:count]))
        assert 0 < frames < len(BOTH)
        assert "its head promises" in said or "its last whole object" in said
    for promised in (0, 144):  # as a recorder leaves it that was killed
        killed = head[:16] + promised.to_bytes(8, "little") + bytes(8) + bytes(8) + head[40:]
        assert count_and_words(folder / "killed.blf", killed + b"".join(containers)) == (len(BOTH), "")


@pytest.mark.parametrize("name", ["a.blf", "plain.blf", "stored.blf"])
def test_room_that_a_recorder_had_made_is_worth_a_word_alone(folder: Path, name: str) -> None:
    data = b"".join(FILES[name]())
    log, said = read(folder / name, data + bytes(5000))
    assert (log.messages, said) == (total(name), "")
    assert "zeros follow its last object" in log.account.notes[0]
    if name == "a.blf":  # in what is not packed, zeros may be data
        frames, said = count_and_words(folder / name, data[:-30] + bytes(5000))
        assert frames < total(name)
        assert said


junk = st.binary(min_size=1, max_size=60).filter(lambda data: b"LOBJ" not in data and not data.isspace())
lines_of_junk = st.lists(st.binary(max_size=60), min_size=1, max_size=3).map(lambda lines: b"\n".join(lines).replace(b"\r", b"?") + b"\n")
END = b"\x00\x00"


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith((".log", ".asc", ".trc", ".csv"))])
@given(data=st.data())
@settings(max_examples=40)
def test_junk_between_lines_costs_no_frame(folder: Path, name: str, data: st.DataObject) -> None:
    pieces = FILES[name]()
    first = 1 if name.endswith(".csv") else 8 if name.endswith(".trc") else 0
    filled = [*pieces]
    for _ in range(data.draw(st.integers(1, 3))):
        filled.insert(data.draw(st.integers(first, len(pieces))), data.draw(lines_of_junk))
    log, said = read(folder / name, b"".join(filled))
    assert log.messages == total(name)
    assert (said != "") == (log.account.odd > 0)
    accounted = log.messages + log.account.odd + sum(log.account.others.values())
    blank = sum(not line.strip() for piece in filled for line in piece.splitlines())
    silent = len([piece for piece in pieces if not piece[:1].isdigit()])  # heads
    assert accounted + blank + silent >= sum(len(piece.splitlines()) for piece in filled)


@pytest.mark.parametrize("name", [name for name in FILES if not name.endswith((".log", ".asc", ".trc", ".csv"))])
@given(data=st.data())
@settings(max_examples=60)
def test_junk_between_objects_costs_no_frame_and_is_said(folder: Path, name: str, data: st.DataObject) -> None:
    pieces = FILES[name]()
    first = 6 if name == "a.pcapng" else 2 if name == "a.pcap" else 1
    filled = [*pieces]
    filled.insert(data.draw(st.integers(first, len(pieces))), data.draw(junk))
    frames, said = count_and_words(folder / name, b"".join(filled))
    assert frames == total(name)
    assert said or not b"".join(filled).strip(b"\0").endswith(pieces[-1].strip(b"\0")) or name.endswith(".blf")


@pytest.mark.parametrize("name", FILES)
@given(at=st.floats(0, 1), noise=st.binary(min_size=1, max_size=30))
@settings(max_examples=40)
def test_junk_anywhere_costs_what_it_touches_at_most(folder: Path, name: str, at: float, noise: bytes) -> None:
    pieces = FILES[name]()
    data = b"".join(pieces)
    begin = sum(map(len, pieces[: 8 if name.endswith(".trc") else 6 if name == "a.pcapng" else 1]))
    place = begin + round(at * (len(data) - begin))
    frames, _ = count_and_words(folder / name, data[:place] + noise + data[place:])
    touched = 300 // 48 + 2 if name in ("a.blf", "stored.blf") else 2
    assert total(name) - touched <= frames <= total(name) + noise.count(b"\n")


@pytest.mark.parametrize("ending", [".gz", ".zst"])
@given(share=st.floats(0.05, 0.999))
@example(share=0.5)
@settings(max_examples=25)
def test_what_is_before_a_tear_in_a_packed_file_is_read(folder: Path, ending: str, share: float) -> None:
    lines = [f"({START + n / 1000:.6f}) can0 {n * 7919 % 2048:03X}#{n * 2654435761 % 2**32:08X}" for n in range(3000)]
    plain = recorded.joined(lines)
    packed = gzip.compress(plain) if ending == ".gz" else zstandard.compress(plain)
    frames, said = count_and_words(folder / f"a.log{ending}", packed[: round(share * len(packed))])
    assert "its packed data ends before its end" in said
    assert ending == ".zst" or frames > share * 3000 * 0.6 - 800
    damaged = bytearray(packed)
    damaged[-2 if ending == ".gz" else len(packed) // 2] ^= 0xFF
    _, said = count_and_words(folder / f"b.log{ending}", bytes(damaged))
    assert said


@given(share=st.floats(0.05, 0.999))
@settings(max_examples=25)
def test_a_torn_database_is_said(folder: Path, share: float) -> None:
    whole = folder / "whole.db"
    if not whole.exists():
        recorded.by_python_can(whole, BOTH * 40)
    data = whole.read_bytes()
    frames, said = count_and_words(folder / "torn.db", data[: round(share * len(data))])
    assert frames < len(BOTH) * 40
    assert "torn.db: " in said
    assert "\n" not in said


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    """Four times the file, the same memory: no reader keeps what it has given."""
    import tracemalloc

    peaks = []
    for repeats in (100, 400):
        path = tmp_path / f"{repeats}.blf"
        objects = OBJECTS * 20
        path.write_bytes(recorded.joined(recorded.blf(objects * repeats, START, 1 << 16)))
        log_path = tmp_path / f"{repeats}.log"
        log_path.write_bytes(recorded.joined(recorded.candump(BOTH) * 20 * repeats))
        for one in (path, log_path):
            tracemalloc.start()
            assert sum(1 for _ in Log(one)) == len(BOTH) * 20 * repeats
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
    assert peaks[2] < 2 * peaks[0] + (1 << 20)
    assert peaks[3] < 2 * peaks[1] + (1 << 20)
    assert max(peaks) < 20 << 20


@pytest.mark.parametrize("name", ["one.blf", "a.log.gz"])
@given(share=st.floats(0.1, 0.95))
@settings(max_examples=30)
def test_what_is_before_a_wrong_bit_in_packed_data_is_read(folder: Path, name: str, share: float) -> None:
    """Of a file that is one packed piece; payloads that no packer makes smaller, so that places in both go together."""
    random = np.random.default_rng(0)
    messages = [can.Message(timestamp=START + n / 1000, channel="can0", is_extended_id=False, data=random.bytes(8)) for n in range(600)]
    if name == "one.blf":
        data = recorded.joined(recorded.blf([recorded.blf_frame(message, START) for message in messages], START, 1 << 20))
    else:
        data = gzip.compress(recorded.joined(recorded.candump(messages)))
    damaged = bytearray(data)
    damaged[200 + round(share * (len(data) - 220))] ^= 0x10
    frames, said = count_and_words(folder / name, bytes(damaged))
    assert said
    assert 600 * (share - 0.3) - 30 < frames <= 601
