"""Lines that are parsed many at once are what they are one by one: the same frames, times to the last bit, and the same account."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.logs.test_readers import frames
from tests.support import recorded

from echogrid.errors import EchogridError
from echogrid.logs.formats.frame import Frame
from echogrid.logs.log import Log
from echogrid.logs.text import by_shape
from echogrid.logs.text.shapes import Shape, shapes

pytestmark = pytest.mark.hypothesis
WRITERS: dict[str, Callable[[list[can.Message]], list[str]]] = {
    "a.log": recorded.candump,
    "a.asc": recorded.asc,
    "r.asc": lambda messages: recorded.asc(messages, "relative"),
    "v11.trc": lambda messages: recorded.trc([message for message in messages if not message.is_fd] or ONE, "1.1"),
    "v20.trc": lambda messages: recorded.trc(messages, "2.0"),
    "v21.trc": recorded.trc,
}
ONE = [can.Message(timestamp=1600000000.0, channel="can0", data=b"1")]
ODD = st.one_of(
    st.text(max_size=40).map(lambda text: "".join(text.split("\n"))),
    st.sampled_from(
        [
            "// a comment",
            "(1.5) can0 123#11.22",
            "(1600000000.123456789) can0 123#1122",
            "(1.5) vcan10 00000123#11 T",
            "(1.5) can0 123#R8_9 X",
            "(1.5) can0 20000004##10004",
            " (1.5)  can0  20000004   [9]  00 04",
            " (1.5)  can0  123   [12]  remote request",
            " (1.5)  can0  123   [99]  remote request",
            "   0.250000 1  FFFFFF          Rx   r 8",
            "      1         0.500 RR 1     0100 Rx -  x",
            "   0.250000 1  Statistic: D 0 R 0",
            "   0.250000 CANFD   1 Rx        311  Name  1 0 f 64 " + "00 " * 64 + " 130000 130 303000 0 0 0 0 0",
            "   0.250000 CANFD   1 Rx        311        0 0 2  2 01 02  130000 130 200000 0 0 0 0 0",
            "   0.250000 CANFD   1 Rx        311        0 0 2  2 01 02",
            "Begin TriggerBlock Sun Sep 13 12:26:41.000 pm 2020",
            "   0.250000 2  18EBFF00x       Rx   d 8 01 02 03 04 05 06 07 08",
            "   0.250000 2  18EBFF00x       Rx   d 8 01 02 03 04 05 06 07 zz",
            "      1         0.500 DT 1     0100 Rx -  2   01 02",
            "      1         0.500 DT 1     0100 Rx -  2   01 02 03",
            "      1         0.500 ST 1     0100 Rx -  4   00 00 00 08",
            ";$STARTTIME=44087.5",
        ]
    ),
)


def read(path: Path, few: int) -> tuple[list[tuple[Any, ...]], str, object]:
    """Frames, what is said at the end, and the account."""
    log, said = Log(path), ""
    found: list[tuple[Any, ...]] = []
    with mock.patch.object(by_shape, "FEW", few):
        try:
            for message in log:  # those before an error count as well
                found.append(tuple(getattr(message, name) for name in Frame.__struct_fields__))
        except EchogridError as error:
            said = str(error)
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
    by_shapes, one_by_one = read(path, 0), read(path, 1 << 30)
    assert by_shapes[0] == one_by_one[0]
    assert by_shapes[1:] == one_by_one[1:]


@given(st.lists(st.text("0123456789abcdefABCDEF .xyz", max_size=24), max_size=20))
def test_every_line_is_of_one_shape_at_most_and_numbers_are_pythons(words: list[str]) -> None:
    lines = [word.encode() for word in words]
    seen: list[int] = []
    for shape in shapes(lines):
        seen += shape.lines.tolist()
        for row, line in enumerate(shape.lines.tolist()):
            assert shape.letters[row].tobytes() == lines[line]
        for word in range(len(shape.words)):
            texts = list(shape.texts(word))
            assert texts == [words[line].split()[word] for line in shape.lines.tolist()]
            for read_as, by_python in (
                (Shape.digits, int),
                (partial(Shape.digits, base=16), partial(int, base=16)),
                (Shape.decimals, float),
            ):
                try:
                    found = read_as(shape, word).tolist()
                except ValueError:
                    continue
                assert found == [by_python(text) for text in texts]
    assert len(seen) == len(set(seen))
