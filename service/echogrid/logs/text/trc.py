"""PEAK's TRC, versions 1.0 to 2.1: columns of text, which later versions name in the head."""

from __future__ import annotations

import re
from binascii import unhexlify
from collections.abc import Iterator
from functools import partial

import numpy as np
from can.util import dlc2len

from echogrid.can.intake.frames import Frame, FrameBatch, error_frame
from echogrid.core.kernels.dispatch import loops
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.stream import Stream
from echogrid.logs.formats.times import timely
from echogrid.logs.text.dates import seconds_of, seconds_of_days
from echogrid.logs.text.lines import Columns, read_lines

FD = {"FD": (False, False), "FB": (True, False), "FE": (True, True), "BI": (False, True)}  # bit rate switch, error state
EXTENDED, STANDARD = 0x1FFFFFFF, 0x7FF
MOST_BYTES, MOST_CLASSIC = 64, 8
COLUMNS = {"1.0": "NOILD", "1.1": "NOdILD", "1.2": "NOBdILD", "1.3": "NOBdIRLD", "2.0": "NOTIdlD", "2.1": "NOTBIdRLD"}
NO_FRAMES = {"ST": "states of the controller", "EC": "error counters", "EV": "events", "WARNG": "states of the controller"}
_OFFSET = re.compile(r"-?\d{1,13}(?:[.,]\d{1,6})?")  # below zero where another bus's frame is older than the first
_SAID = re.compile(r";\s*\$?(FILEVERSION|STARTTIME|COLUMNS|Start time)\s*[=:](.*)", re.IGNORECASE)


def read(stream: Stream, account: Account) -> Iterator[FrameBatch]:
    """The frames; channels as the file numbers them, from 1, or None where it has no column for them."""
    head = _Head(account)
    yield from read_lines(stream, account, head.take, partial(_any, head=head))


def _any(line: bytes, number: int, *, head: _Head) -> Frame | None:
    text = line.decode("latin-1").strip()
    if text.startswith(";"):
        head.add(text)
    elif text:
        try:
            return head.account.kind(_frame(text, head))
        except (ValueError, IndexError) as error:
            head.account.line(number, line, error)
    return None


class _Head:
    """Remembers the head: `columns` are positions by PEAK's letters, `start` is the file's time 0 in seconds since 1970."""

    def __init__(self, account: Account) -> None:
        self.account = account
        self.version = ""
        self.columns: dict[str, int] = {}
        self.start = 0.0
        self._exact = False
        self._letters = np.empty(0, np.uint8)  # of the columns, where data is the last one

    def take(self, columns: Columns, text: bytes) -> None:
        """Lines of data frames, once the columns are known."""
        loops.trc_lines(*columns.arguments(text), self._letters, self.start)

    def add(self, text: str) -> None:
        """A line that begins with a semicolon."""
        self.account.others["comments"] += 1
        found = _SAID.match(text)
        if found is None:
            return
        key, value = found[1].upper(), found[2].strip()
        if key == "FILEVERSION":
            self.version = value
            self._name(COLUMNS.get(value, ""))
        elif key == "COLUMNS":
            self._name("".join(value.replace(",", "").split()))
        elif key == "STARTTIME" and (start := seconds_of_days(value)) is not None:
            self.start, self._exact = start, True
        elif key == "START TIME" and not self._exact and (start := seconds_of(value)) is not None:
            self.start = start

    def look(self, words: list[str]) -> None:
        """Before the first line of data: of old versions some files say nothing, or less than they should."""
        if self.version and not self.columns:
            raise ValueError(f"TRC version {self.version} is not known, expected one of {', '.join(COLUMNS)}")
        if not self.columns:
            second, third = [*words, "", ""][2:4]
            two = third.upper() in ("RX", "TX", "WARNG", "ERROR")
            one = second.upper() in ("RX", "TX", "WARNG", "ERROR")
            self._name(COLUMNS["1.1" if one else ("1.3" if words[5:6] == ["-"] else "1.2") if two else "1.0"])

    def _name(self, letters: str) -> None:
        if letters:
            self.columns = {letter: position for position, letter in enumerate(letters)}
            known = letters.isascii() and set("OID") <= set(letters) and len(self.columns) == len(letters) and letters.endswith("D")
            one_length = ("l" in letters) != ("L" in letters)
            self._letters = np.frombuffer(letters.encode() if known and one_length else b"", np.uint8)


def _frame(text: str, head: _Head) -> Frame | None:
    """A line's frame, or None where it is another thing that the account knows. Raises ValueError, IndexError."""
    if not head.columns:
        head.look(text.split())
    at = head.columns
    words = text.split(None, len(at) - 1)
    kind, way = words[at["T"]].upper() if "T" in at else "", words[at["d"]].upper() if "d" in at and "T" not in at else ""
    offset = words[at["O"]].replace(",", ".")
    if not _OFFSET.fullmatch(offset):
        raise ValueError("no time")
    if (kind or way) in NO_FRAMES:
        head.account.others[NO_FRAMES[kind or way]] += 1
        return None
    stamp = timely(head.start + float(offset) / 1000)
    if (kind or way) in ("ER", "ERROR"):
        return _error(stamp, words, head)
    if "T" in at and kind != "DT" and kind != "RR" and kind not in FD:
        raise ValueError("no type")
    identifier = words[at["I"]]
    if kind == "" and identifier.upper() == "FFFFFFFF":
        head.account.others["states of the controller"] += 1
        return None
    if "d" in at and words[at["d"]].upper() not in ("RX", "TX"):
        raise ValueError("neither received nor sent")
    code, extended = int(identifier, 16), len(identifier) > 4
    if code > (EXTENDED if extended else STANDARD):
        raise ValueError("no id")
    payload = words[at["D"]] if len(words) > at["D"] else ""
    remote = kind == "RR" or payload.upper() == "RTR"
    length = _length(words, at, kind in FD)
    data = b"" if remote else unhexlify(payload.replace(" ", "").replace("\t", ""))
    if not remote and len(data) != length:
        raise ValueError("its length is another")
    switch, state = FD.get(kind, (False, False))
    return Frame(
        stamp,
        code,
        extended,
        remote,
        False,
        int(words[at["B"]]) if "B" in at else None,
        length,
        data,
        kind in FD,
        "d" not in at or words[at["d"]].upper() == "RX",
        switch,
        state,
    )


def _length(words: list[str], at: dict[str, int], fd: bool) -> int:
    """Bytes: column `l` counts them, `L` has the code for them, which is the same up to 8. Raises ValueError."""
    written = int(words[at["l" if "l" in at else "L"]])
    length = written if "l" in at else dlc2len(written)
    if written < 0 or length > MOST_BYTES:
        raise ValueError("no length")
    return length if fd else min(length, MOST_CLASSIC)


def _error(stamp: float, words: list[str], head: _Head) -> Frame:
    bus = words[head.columns["B"]] if "B" in head.columns else ""
    return error_frame(stamp, int(bus) if bus.isdigit() else None)
