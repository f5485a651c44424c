"""Lines in the file's order: most of them many at once by a compiled loop, and all others one by one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import Frame, FrameBatch, channel_number, flags_of
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.stream import Stream

MOST_NAMES, LONGEST_NAME = 32, 64  # channels that the loops know by name
MOST_BYTES = 64  # of a frame
_END = re.compile(rb"\r\n|\r|\n")


Bytes = NDArray[np.uint8]
Arguments = tuple[
    Bytes, NDArray[np.int64], NDArray[np.float64], NDArray[np.uint32], Bytes, Bytes, Bytes, NDArray[np.int64], Bytes, NDArray[np.int32]
]


class Columns:
    """Frames of one block of text. `place` (4,): byte of the text, frames, lines and bytes of data so far."""

    def __init__(self, lines: int, size: int) -> None:
        """Room for the frames of so many lines and bytes of text."""
        self.place = np.zeros(4, np.int64)
        self.names: dict[str, int] = {}
        self._rows = np.zeros((0, LONGEST_NAME), np.uint8)
        self.stamps = np.empty(lines, np.float64)
        self.ids = np.empty(lines, np.uint32)
        self.flags, self.dlc, self.sizes = (np.empty(lines, np.uint8) for _ in range(3))
        self.begins = np.empty(lines, np.int64)
        self.data = np.empty(size + MOST_BYTES, np.uint8)
        self.channels = np.empty(lines, np.int32)

    def arguments(self, text: bytes) -> Arguments:
        """What all loops over lines have in common."""
        columns = (self.stamps, self.ids, self.flags, self.dlc, self.sizes, self.begins, self.data, self.channels)
        return np.frombuffer(text, np.uint8), self.place, *columns

    def add(self, frame: Frame) -> None:
        """The next frame, of a line that was read alone."""
        n, begin, size = int(self.place[1]), int(self.place[3]), len(frame.data)
        self.channels[n] = channel_number(frame.channel, self.names)
        self.stamps[n], self.ids[n], self.flags[n] = frame.timestamp, frame.arbitration_id, flags_of(frame)
        self.dlc[n], self.sizes[n], self.begins[n] = frame.dlc, size, begin
        self.data[begin : begin + size] = np.frombuffer(frame.data, np.uint8)
        self.place[1] += 1
        self.place[3] += size

    def name_rows(self) -> Bytes:
        """(K, LONGEST_NAME) the first names as bytes, filled up with zeros; one that is longer is left out, all zeros."""
        for name in list(self.names)[len(self._rows) : MOST_NAMES]:
            row = name.encode() if len(name) <= LONGEST_NAME else b""
            self._rows = np.append(self._rows, np.frombuffer(row.ljust(LONGEST_NAME, b"\0"), np.uint8)[None], axis=0)
        return self._rows

    def batch(self) -> FrameBatch:
        """All so far."""
        n, size = int(self.place[1]), int(self.place[3])
        return FrameBatch(
            self.stamps[:n],
            self.ids[:n],
            self.flags[:n],
            self.dlc[:n],
            self.sizes[:n],
            self.begins[:n],
            self.data[:size],
            self.channels[:n],
            tuple(self.names),
        )


Plain = Callable[[Columns, bytes], None]  # takes lines of the text from the columns' place on, as far as they have the usual form
Other = Callable[[bytes, int], Frame | None]  # of any line and its number; tells the account where there is none


def read_lines(stream: Stream, account: Account, plain: Plain, other: Other) -> Iterator[FrameBatch]:
    """The frames, block by block. Of an odd line the account is told by `other`, or here where its frame fits no column."""
    for first, count, text in stream.blocks():
        columns = Columns(count, len(text))
        place = columns.place
        while True:
            plain(columns, text)
            at = int(place[0])
            if at >= len(text):
                break
            end = _END.search(text, at)
            line = text[at : end.start() if end else len(text)]
            number = first + int(place[2])
            place[0], place[2] = end.end() if end else len(text), place[2] + 1
            frame = other(line, number)
            if frame is None:
                continue
            try:
                columns.add(frame)
            except (ValueError, OverflowError):
                account.line(number, line)
        yield columns.batch()
