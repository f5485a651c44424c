"""What the compiled loops take of a recording is what the line readers make of it: the same frames, times to the last bit, and account."""

from __future__ import annotations

import struct
from base64 import b64encode
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.logs.test_readers import LENGTHS, frames
from tests.support import recorded

from echogrid.can.intake.frames import Frame
from echogrid.core.kernels import reference
from echogrid.errors import EchogridError
from echogrid.logs.formats import blf
from echogrid.logs.log import Log
from echogrid.logs.text import asc, candump, csv_log, trc

compiled: Any = pytest.importorskip("echogrid.core.kernels.compiled", reason="no C compiler was at hand when echogrid was installed")
pytestmark = pytest.mark.hypothesis
WRITERS: dict[str, Callable[[list[can.Message]], list[str]]] = {
    "a.log": recorded.candump,
    "a.asc": recorded.asc,
    "r.asc": lambda messages: recorded.asc(messages, "relative"),
    "v11.trc": lambda messages: recorded.trc([message for message in messages if not message.is_fd] or ONE, "1.1"),
    "v20.trc": lambda messages: recorded.trc(messages, "2.0"),
    "v21.trc": recorded.trc,
    "p.csv": recorded.python_can_csv,
}
MODULES = (candump, asc, trc, csv_log, blf)
NOISE = [b"\0", b"\0\0\0", b"\0" * 4, b"junk", b"LOBJ", b"LOBJ\x10\0\1\0"]
ONE = [can.Message(timestamp=1600000000.0, channel="can0", data=b"1")]
FD_LENGTHS = ((9, 12), (10, 16), (11, 20), (12, 24), (13, 32), (14, 48), (15, 64))  # by their codes
ODD_LINES = {
    ".log": [
        "(1.5) can0 123#11.22",
        "(15) can0 123#1122",
        "(1.5) can0 800#1122",
        "(1.5) can0 1234#1122  R ",
        "(2147483648.5) can0 123#1122",
        "(2147483648.000000) can0 123#1122",
        "(1.5) can0 123#112233445566778899",
        "(12345678901.123456789) can0 123#1122",
        "(1.5) caf\u00e9 123#1122",
        "(1.5) \\xe9 123#1122",
        "(1.5) can0 123##5" + "00" * 64,
        "(1.5) can0 123##5" + "00" * 65,
        "(1600000000.123456789) can0 123#1122",
        "(1.5) vcan10 00000123#11 T",
        "(1.5) can0 123#R8_9 X",
        "(1.5) can0 20000004##10004",
        " (1.5)  can0  20000004   [9]  00 04",
        " (1.5)  can0  123   [12]  remote request",
        " (1.5)  can0  123   [99]  remote request",
        "(1.5) can0 12#1122",
        "(1.) can0 123#1122",
    ],
    ".asc": [
        "// a comment",
        "   0.250000 1  FFFFFF          Rx   r 8",
        "   0.250000 1  Statistic: D 0 R 0",
        "   0.250000 CANFD   1 Rx        311  Name  1 0 f 64 " + "00 " * 64 + " 130000 130 303000 0 0 0 0 0",
        "   0.250000 CANFD   1 Rx        311        0 0 2  2 01 02  130000 130 200000 0 0 0 0 0",
        "   0.250000 CANFD   1 Rx        311        0 0 2  2 01 02",
        "Begin TriggerBlock Sun Sep 13 12:26:41.000 pm 2020",
        "   0.250000 2  18EBFF00x       Rx   d 8 01 02 03 04 05 06 07 08",
        "   0.250000 2  18EBFF00        Rx   d 8 01 02 03 04 05 06 07 08",
        "9999999999.9 2  100        Rx   d 1 01",
        "   0,250000 2  100        Rx   d 1 01",
        "   0.25 2  100        Tx   d 1 01 more",
        "   0.25 2  100        Tx   d 1 011",
        "   0.25 2  100        Tx   d 9 01 02 03 04 05 06 07 08",
        "   0.25 2  100        Tx   d 9 01 02 03 04 05 06 07 08 09",
        "   0.25 2  100        Rx   d 0 ",
        "base hex  timestamps relative",
        "base dec  timestamps absolute",
        "   0.250000 CANFD   1 Rx        311   1 0 0 2  2 01 02  130000 130 200000 0 0 0 0 0",
        "   0.250000 CANFD   1 Rx        311  1 0 0  0  130000 130 1000 0 0 0 0 0",
        "   0.250000 CANFD   1 Rx        311  1 0 2  2 01 02  130000 130 1000z",
        "   0.250000 2  18EBFF00x       Rx   d 8 01 02 03 04 05 06 07 zz",
        "   0.250000 CANFD   1 Rx        311  1 0 0  0  130000 130 1010 0 0 0 0 0",
        "   0.250000 CANFD   1 Rx        311  1 0 2  2 01 02  130000 130 1 0 0 0 0 0",
    ],
    ".trc": [
        "      1         0.500 RR 1     0100 Rx -  x",
        "      1         0.500 DT 1     0100 Rx -  2   01 02",
        "      1         0.500 DT 1     0100 Rx -  2   01 02 03",
        "      1         0.500 ST 1     0100 Rx -  4   00 00 00 08",
        ";$STARTTIME=44087.5",
        ";$COLUMNS=N,O,T,I,d,L,D",
        "      1         0.500 FB 1     0100 Rx -  9   " + "01 " * 12,
        "      1         0.500 DT 1     0100 Rx -  9   " + "01 " * 8,
        "      1         0.500 DT 1 00000100 Tx -  1   01  ",
        "x     1         0.500 DT 1 00000100 Tx -  1   01",
        "      1         0.500 DT 1    00100 Rx -  1   01",
        "      1            1. DT 1     0100 Rx -  1   01",
        *(f"      1         0.500 FB 1     0100 Rx -  {code}   " + "01 " * size for code, size in FD_LENGTHS),
    ],
    ".csv": [
        "1600000001.1234567,0x123,0,0,0,3,AQID",
        "1600000001.12345678,0x800,0,0,0,2,AQI=",
        "1600000001.5,0x123,1,0,0,3,AQI=",
        "1600000001.5,0x123,1,0,0,1,AR==",
        "1600000001.5,0x123,1,0,0,1,AQ==\t",
        "1600000001.5,123,1,0,0,9," + "AAAA" * 4,
        "1600000001.5,0x123,1,0,0,9," + "AAAA" * 4,
        "1600000001.5,0x123,0,1,0,8,",
        "0.1,0x1,0,0,0,0,",
        "1600000001.5,0x123,1,0,0,2,AQJ=",
        "1600000001.5,0x123,1,0,0,0,A===",
        "1.,0x123,1,0,0,1,AQ==",
        *(f"1.{'0123456789' * 2:.{digits}},0x123,1,0,0,1,AQ==" for digits in range(9, 14)),
        *(f"1600000001.5,0x123,1,0,0,{code},{b64encode(bytes(range(size))).decode()}" for code, size in FD_LENGTHS),
    ],
}
ODD = st.one_of(
    st.text(max_size=40).map(lambda text: "".join(text.split("\n"))),
    st.sampled_from([line for lines in ODD_LINES.values() for line in lines]),
)


def read(path: Path, loops: Any) -> tuple[list[tuple[Any, ...]], str, object]:
    """Frames, what is said at the end, and the account."""
    log, said = Log(path), ""
    found: list[tuple[Any, ...]] = []
    patches = [mock.patch.object(module, "loops", loops) for module in MODULES]
    for patch in patches:
        patch.start()
    try:
        for message in log:  # those before an error count as well
            found.append(tuple(getattr(message, name) for name in Frame.__struct_fields__))
    except EchogridError as error:
        said = str(error)
    finally:
        for patch in patches:
            patch.stop()
    frames_by_kind = sum(frame[3] for frame in found), sum(frame[4] for frame in found)
    assert (log.account.remote, log.account.errors) == frames_by_kind
    return found, said, (log.account, log.messages, log.times.first, log.times.last)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shapes")


@pytest.mark.parametrize("name", WRITERS)
@given(messages=frames(), odd=st.lists(st.tuples(st.integers(0, 30), ODD), max_size=4), repeats=st.integers(1, 3))
@settings(max_examples=60)
def test_many_at_once_are_as_one_by_one(
    folder: Path, name: str, messages: list[can.Message], odd: list[tuple[int, str]], repeats: int
) -> None:
    lines = WRITERS[name](messages * repeats)
    for at, line in odd:
        lines.insert(min(at, len(lines)), line)
    path = folder / name
    path.write_bytes("\n".join([*lines, ""]).encode("latin-1", "replace"))
    at_once, one_by_one = read(path, compiled), read(path, reference)
    assert at_once[0] == one_by_one[0]
    assert at_once[1:] == one_by_one[1:]


@pytest.mark.parametrize("name", WRITERS)
def test_an_odd_byte_anywhere_in_a_line_is_read_alike(folder: Path, name: str) -> None:
    """What separates words is not the same in each language: so every byte that does somewhere, in every place of the last line."""
    fd = name in ("a.asc", "r.asc", "v20.trc", "v21.trc")
    message = can.Message(timestamp=1.6e9, channel="can0", arbitration_id=0x123, is_extended_id=False, data=b"\x11\x22", is_fd=fd)
    *head, line = (text.encode() for text in WRITERS[name]([message]) if not text.startswith("End"))
    places = range(len(line))
    odd = [line[:at] + bytes([byte]) + line[at + more :] for at in places for byte in b"\0\t\x0b\x0c\x1c\x85\xa0" for more in (0, 1)]
    path = folder / name
    path.write_bytes(b"\n".join([*head, *odd, b""]))
    assert read(path, compiled) == read(path, reference)


@pytest.mark.parametrize("name", WRITERS)
def test_each_odd_line_of_a_format_is_read_at_once_as_one_by_one(folder: Path, name: str) -> None:
    """A file for each, since some end the recording; between two lines that are plain."""
    first, last = WRITERS[name](ONE)[:-1], WRITERS[name](ONE)[-1]
    for line in ODD_LINES[Path(name).suffix]:
        path = folder / name
        path.write_bytes("\n".join([*first, last, line, last, ""]).encode("latin-1", "replace"))
        assert read(path, compiled) == read(path, reference), line


@given(
    messages=frames(),
    noise=st.lists(
        st.tuples(st.integers(1, 12), st.sampled_from([b"\0", b"\0\0\0", b"\0" * 4, b"junk", b"LOBJ", b"LOBJ\x10\0\1\0"])), max_size=2
    ),
    size=st.integers(40, 3000),
)
@settings(max_examples=60)
def test_objects_stepped_over_at_once_are_as_one_by_one(
    folder: Path, messages: list[can.Message], noise: list[tuple[int, bytes]], size: int
) -> None:
    objects = [recorded.blf_frame(message, messages[0].timestamp) for message in messages]
    for at, junk in noise:
        objects.insert(at, junk)
    path = folder / "a.blf"
    path.write_bytes(recorded.joined(recorded.blf(objects, messages[0].timestamp, size)))
    at_once, one_by_one = read(path, compiled), read(path, reference)
    assert at_once[0] == one_by_one[0]
    assert at_once[1:] == one_by_one[1:]


HAVE_FD = ("a.log", "a.asc", "r.asc", "v20.trc", "v21.trc")


def test_an_object_of_more_than_64_kib_is_stepped_over(folder: Path) -> None:
    first, last = (recorded.blf_frame(can.Message(timestamp=1.6e9 + n, channel="can0", data=bytes([n])), 1.6e9) for n in range(2))
    large = struct.pack("<4sHHII", b"LOBJ", 16, 1, 0x12344, 65) + bytes(0x12344 - 16)
    path = folder / "large.blf"
    path.write_bytes(recorded.joined(recorded.blf([first, large, last], 1.6e9, 1 << 20)))
    at_once, one_by_one = read(path, compiled), read(path, reference)
    assert at_once == one_by_one
    assert len(at_once[0]) == 2


@pytest.mark.parametrize("name", ["a.log", "a.asc", "r.asc", "v11.trc", "v20.trc", "v21.trc", "p.csv"])
def test_the_loops_take_the_lines_that_files_are_made_of(folder: Path, name: str) -> None:
    """Else all is right and slow."""
    shapes = [(n // 3 % 2, n % 3 == 0, n % 2 == 0 and name in HAVE_FD, n % 5 > 0) for n in range(50)]
    messages = [
        can.Message(
            timestamp=1.6e9 + n / 1000,
            channel=f"can{bus}",
            is_extended_id=wide,
            data=bytes(LENGTHS[n // 2 % (16 if is_fd else 9)]),
            is_fd=is_fd,
            is_rx=heard,
            arbitration_id=0x123,
        )
        for n, (bus, wide, is_fd, heard) in enumerate(shapes)
    ]
    path = folder / name
    lines = WRITERS[name](messages)
    path.write_bytes(recorded.joined(lines))
    module = {".log": candump, ".asc": asc, ".trc": trc, ".csv": csv_log}[path.suffix]
    one_by_one = {candump: "_other", asc: "_any", trc: "_any"}.get(module)
    if one_by_one is None:
        with mock.patch.object(csv_log, "_python_can", wraps=csv_log._python_can) as alone:
            assert len(list(Log(path))) == 50
    else:
        with mock.patch.object(module, one_by_one, wraps=getattr(module, one_by_one)) as alone:
            assert len(list(Log(path))) == 50
    assert alone.call_count <= max(len(lines) - 50, 2)  # what is above the frames; of a name the first frame
