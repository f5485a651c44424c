"""The lines of ASC that most files are made of, many at once: hexadecimal data frames with absolute times."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import repeat

from echogrid.logs.formats.frame import Frame
from echogrid.logs.formats.times import END_OF_TIME
from echogrid.logs.text.shapes import Shape

EDL, REMOTE = 0x1000, 0x10  # among the flags of a CANFD line
EXTENDED, STANDARD = 0x1FFFFFFF, 0x7FF
MOST_BYTES, MOST_CLASSIC = 64, 8
NO: Iterator[bool] = repeat(False)


def plain(shape: Shape, origin: float) -> Iterator[Frame]:
    """The frames of lines of one shape; `origin`: s since 1970 of the file's time 0. Raises ValueError, IndexError."""
    return _fd(shape, origin) if shape.text(1) == "CANFD" else _classic(shape, origin)


def _classic(shape: Shape, origin: float) -> Iterator[Frame]:
    """Time, channel, id, Rx or Tx, d, length, data, and what may follow. Raises ValueError, IndexError."""
    size = int(shape.text(5) or "-1")
    if shape.text(4) != "d" or not 0 <= size <= MOST_CLASSIC:
        raise ValueError("not all are data of one size")
    codes, extended = _codes(shape, 2)
    data, received = shape.payloads(6, size), shape.is_letter(3, "Rx", "Tx").tolist()
    return map(Frame, _stamps(shape, origin), codes, extended, NO, NO, _channels(shape, 1), repeat(size), data, NO, received)


def _fd(shape: Shape, origin: float) -> Iterator[Frame]:
    """Time, CANFD, channel, Rx or Tx, id, a name or none, two bits, code, length, data, duration, length in bits, flags.

    Raises ValueError, IndexError.
    """
    at = 5 if shape.words[5][1] - shape.words[5][0] == 1 else 6
    size = int(shape.text(at + 3) or "-1")
    if not 0 <= size <= MOST_BYTES:
        raise ValueError("not all are of one size")
    codes, extended = _codes(shape, 4)
    flags = shape.digits(at + 4 + size + 2, 16)
    flexible = flags & EDL != 0
    if (flags & REMOTE).any() or (size == 0 and not flexible.all()):
        raise ValueError("one may be a remote frame")
    bits = (flexible, shape.is_letter(3, "Rx", "Tx"), shape.is_letter(at, "1", "0"), shape.is_letter(at + 1, "1", "0"))
    data = shape.payloads(at + 4, size)
    columns = (column.tolist() for column in bits)
    return map(Frame, _stamps(shape, origin), codes, extended, NO, NO, _channels(shape, 2), repeat(size), data, *columns)


def _codes(shape: Shape, word: int) -> tuple[list[int], Iterator[bool]]:
    last = shape.letters[:, shape.words[word][1] - 1] | 0x20
    wide = bool(last[0] == ord("x"))
    if ((last == ord("x")) != wide).any():
        raise ValueError("not all ids are of one kind")
    codes = shape.digits(word, 16, cut=wide)
    if codes.max() > (EXTENDED if wide else STANDARD):
        raise ValueError("no id")
    listed: list[int] = codes.tolist()
    return listed, repeat(wide)


def _channels(shape: Shape, word: int) -> list[int]:
    channels = shape.digits(word)
    if channels.max() > 999:
        raise ValueError("no channel")
    listed: list[int] = channels.tolist()
    return listed


def _stamps(shape: Shape, origin: float) -> list[float]:
    stamps = shape.decimals(0) + origin
    if stamps.max() >= END_OF_TIME:
        raise ValueError("no time")
    listed: list[float] = stamps.tolist()
    return listed
