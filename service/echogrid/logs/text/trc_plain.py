"""The lines of TRC that most files are made of, many at once: data frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import repeat

from can.util import dlc2len

from echogrid.logs.formats.frame import Frame
from echogrid.logs.formats.times import END_OF_TIME
from echogrid.logs.text.shapes import Shape

FD = {"FD": (False, False), "FB": (True, False), "FE": (True, True), "BI": (False, True)}  # bit rate switch, error state
EXTENDED, STANDARD = 0x1FFFFFFF, 0x7FF
MOST_BYTES, MOST_CLASSIC = 64, 8


def plain(shape: Shape, columns: Mapping[str, int], start: float) -> Iterator[Frame]:
    """The frames of lines of one shape; `columns`: positions by PEAK's letters, `start`: s since 1970 of the file's time 0.

    Raises ValueError, IndexError, KeyError.
    """
    kind = shape.text(columns["T"]) if "T" in columns else "DT"
    if kind != "DT" and kind not in FD:
        raise ValueError("not all are data of one kind")
    size = length_of(int(shape.text(columns.get("l", columns.get("L", -1))) or "-1"), "l" in columns, kind in FD)
    number = columns["I"]
    wide = shape.words[number][1] - shape.words[number][0] > 4
    codes, offsets = shape.digits(number, 16), shape.decimals(columns["O"])
    stamps = start + offsets / 1000
    if codes.max() > (EXTENDED if wide else STANDARD) or stamps.max() >= END_OF_TIME:
        raise ValueError("no id, or no time")
    first = columns["D"]
    if size == 0 and len(shape.words) > first:
        raise ValueError("a remote frame")
    data = shape.payloads(first, size)
    if len(shape.words) > first + size:
        raise ValueError("more than its bytes")
    channels = shape.digits(columns["B"]).tolist() if "B" in columns else repeat(None)
    received = shape.is_letter(columns["d"], "Rx", "Tx").tolist() if "d" in columns else repeat(True)
    switch, state = FD.get(kind, (False, False))
    no, flexible = repeat(False), repeat(kind in FD)
    times, numbers = stamps.tolist(), codes.tolist()
    return map(Frame, times, numbers, repeat(wide), no, no, channels, repeat(size), data, flexible, received, repeat(switch), repeat(state))


def length_of(written: int, is_bytes: bool, fd: bool) -> int:
    """Bytes: column `l` counts them, `L` has the code for them, which is the same up to 8. Raises ValueError."""
    length = written if is_bytes else dlc2len(written)
    if written < 0 or length > MOST_BYTES:
        raise ValueError("no length")
    return length if fd else min(length, MOST_CLASSIC)
