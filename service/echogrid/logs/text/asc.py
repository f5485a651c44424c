"""Vector's ASC: text, with or without a head, of which some lines are frames."""

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
from echogrid.logs.formats.times import END_OF_TIME, timely
from echogrid.logs.text.dates import seconds_of
from echogrid.logs.text.lines import Columns, read_lines

EDL, REMOTE = 0x1000, 0x10  # among the flags of a CANFD line
EXTENDED, STANDARD = 0x1FFFFFFF, 0x7FF
LATEST_NS = END_OF_TIME * 1_000_000_000
_TIME, _ID = rb"\s*(\d{1,10}[.,]\d{1,9})\s+", rb"([0-9A-F]{1,10})(x?)\s+"
_CLASSIC = re.compile(_TIME + rb"(\d{1,3})\s+" + _ID + rb"(Rx|Tx)\s+([dr])(?:\s+([0-9A-F]{1,2}))?(?:\s+(.*))?", re.IGNORECASE)
_FD = re.compile(
    _TIME + rb"CANFD\s+(\d{1,3})\s+(Rx|Tx)\s+" + _ID + rb"(?:\S+\s+)??([01])\s+([01])\s+([0-9A-F]{1,2})\s+(\d{1,2})(?:\s+(.*))?",
    re.IGNORECASE,
)
_EVENT = re.compile(rb"\s*(-?\d{1,10}[.,]\d{1,9})\s+(.*)")
_ON_CHANNEL = re.compile(rb"(?:CANFD\s+)?(\d{1,3})\s+(?:(Rx|Tx)\s+)?(.*)", re.IGNORECASE)
_REQUEST = re.compile(rb"\S+\s+TxRq\b.*|TxRq\b.*", re.IGNORECASE)
_HEAD = re.compile(rb"base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.IGNORECASE)
_DATE = re.compile(rb"(date|begin\s+trigger\s?block)\b(.*)", re.IGNORECASE)
_SILENT = re.compile(
    rb"(no\s+)?internal\s+events\s+logged|end\s+trigger\s?block|(previous|next)\s+log\s+file\b.*|measurement\s+uuid\b.*", re.IGNORECASE
)
MEASUREMENT, CONTROLLER = "marks of the measurement", "states of the controller"
KINDS = {b"canxl": "CAN XL frames", b"start": MEASUREMENT, b"log": MEASUREMENT, b"can": CONTROLLER}
BUSES = (  # how events of other buses begin
    (re.compile(rb"(L\d|Li|Tx?Li|Lin)"), "LIN"),
    (re.compile(rb"M\d"), "MOST"),
    (re.compile(rb"eth", re.IGNORECASE), "Ethernet"),
    (re.compile(rb"fr", re.IGNORECASE), "FlexRay"),
    (re.compile(rb"j1939", re.IGNORECASE), "J1939"),
    (re.compile(rb"(a429|afdx)", re.IGNORECASE), "avionics"),
)


def read(stream: Stream, account: Account) -> Iterator[FrameBatch]:
    """The frames; channels as the file numbers them, from 1. Relative times count from the line before, whatever it is."""
    head = _Head(account)
    yield from read_lines(stream, account, head.take, partial(_any, head=head))


def _any(line: bytes, number: int, head: _Head) -> Frame | None:
    try:
        return head.account.kind(_classic(line, head) or _fd(line, head) or _other(line, head))
    except ValueError as error:
        head.account.line(number, line, error)
    return None


class _Head:
    """Remembers what head lines said, and the time of the line before."""

    def __init__(self, account: Account) -> None:
        self.account = account
        self.base = 16
        self.relative = False
        self.date: float | None = None  # of the head, s since 1970
        self.origin = 0.0  # s since 1970 of the file's time 0
        self._block: float | None = None  # date of a trigger block of which no line was seen yet
        self._newest_ns = -1  # of the newest line
        self._total_ns = 0  # of relative times

    def take(self, columns: Columns, text: bytes) -> None:
        """Lines of hexadecimal data frames, unless the next one says where a block begins."""
        if self._block is not None or self.base != 16 or self._total_ns >= LATEST_NS:
            return
        clock, frames = np.array([self._total_ns], np.int64), int(columns.place[1])
        loops.asc_lines(*columns.arguments(text), clock, self.relative, self.origin)
        if columns.place[1] > frames:
            self._newest_ns = int(clock[0])
            self._total_ns = self._newest_ns if self.relative else self._total_ns

    def stamp(self, text: bytes) -> float:
        """A line's time in seconds. Raises ValueError where it cannot be one."""
        digits, _, fraction = text.replace(b",", b".").partition(b".")
        raw = int(digits) * 1_000_000_000 + int(fraction.ljust(9, b"0"))
        if self.relative:
            raw = self._total_ns = self._total_ns + raw
        if self._block is not None:
            self._place(self._block, raw / 1e9)
            self._block = None
        self._newest_ns = raw
        return timely(raw / 1e9 + self.origin)

    def _place(self, block: float, at: float) -> None:
        """Where a block begins at its time `at`. Times count from the head's date, which is the measurement's start, unless they do not fit
        it: some writers put the time of writing there, and some begin at 0 in each block."""
        fits = self.date is not None and abs(self.date + at - block) < 2.0 and at >= 1.0
        if fits and self.date is not None:
            self.origin = self.date
        elif at <= self._newest_ns / 1e9 or self._newest_ns < 0:
            self.origin = block

    def dated(self, line: bytes) -> bool:
        """Whether a line is one that gives a date, which is then known."""
        found = _DATE.match(line.strip())
        if found is None:
            return False
        text = found[2]
        try:
            said = text.decode()
        except UnicodeDecodeError:
            said = text.decode("cp1252", "replace")
        seconds = seconds_of(said)
        if seconds is None:
            self.account.note(f"its date '{said.strip()[:60]}' cannot be read")
        elif found[1].lower() == b"date":
            self.date = self.origin = seconds
        else:
            self._block = seconds
        return True


def _classic(line: bytes, head: _Head) -> Frame | None:
    found = _CLASSIC.fullmatch(line)
    if found is None:
        return None
    time, channel, identifier, extended, way, kind, code, rest = found.groups()
    stamp = head.stamp(time)
    length = min(dlc2len(int(code, head.base)), 8) if code else 0
    remote = kind in b"rR"
    if code is None and not remote:
        raise ValueError("no length")
    return Frame(
        stamp,
        _id(identifier, extended, head.base),
        extended != b"",
        remote,
        False,
        int(channel),
        length,
        b"" if remote else _data(rest or b"", length, head.base),
        False,
        way in (b"Rx", b"rx", b"RX"),
    )


def _fd(line: bytes, head: _Head) -> Frame | None:
    found = _FD.fullmatch(line)
    if found is None:
        return None
    time, channel, way, identifier, extended, switch, state, code, count, rest = found.groups()
    stamp, length = head.stamp(time), int(count)
    if length > 64:
        raise ValueError("too long")
    data = _data(rest or b"", length, head.base)
    tail = (rest or b"").split(None, length + 3)[length : length + 3]  # duration, length in bits, flags
    flags = int(tail[2], 16) if len(tail) == 3 and tail[2].isalnum() else EDL
    dlc = int(code, head.base)
    remote = (length == 0 and dlc > 0 and not flags & EDL) or flags & REMOTE != 0
    return Frame(
        stamp,
        _id(identifier, extended, head.base),
        extended != b"",
        remote,
        False,
        int(channel),
        min(dlc, 8) if remote else length,
        data,
        flags & EDL != 0,
        way in (b"Rx", b"rx", b"RX"),
        switch == b"1",
        state == b"1",
    )


def _id(identifier: bytes, extended: bytes, base: int) -> int:
    code = int(identifier, base)
    if code > (EXTENDED if extended else STANDARD):
        raise ValueError("no id")
    return code


def _data(rest: bytes, length: int, base: int) -> bytes:
    """Raises ValueError unless so many bytes stand there."""
    if base == 16:
        packed = rest[: 3 * length - 1].replace(b" ", b"") if length else b""
        if len(packed) == 2 * length and rest[3 * length - 1 : 3 * length] in (b" ", b""):
            return unhexlify(packed)
    words = rest.split(None, length)[:length]
    if len(words) < length or (base == 16 and any(len(word) > 2 for word in words)):
        raise ValueError("bytes are missing")
    return bytes(int(word, base) for word in words)


def _other(line: bytes, head: _Head) -> Frame | None:
    """A line that is no data or remote frame. Raises ValueError where nothing is known of its kind."""
    text, others = line.strip(), head.account.others
    if not text or _SILENT.fullmatch(text) or head.dated(line):
        return None
    if text.startswith(b"//"):
        others["comments"] += 1
        return None
    if found := _HEAD.match(text):
        head.base = 16 if found[1].lower() == b"hex" else 10
        head.relative = (found[2] or b"").lower() == b"relative"
        return None
    event = _EVENT.fullmatch(line)
    if event is None:
        raise ValueError("no event")
    stamp = 0.0 if event[1].startswith(b"-") else head.stamp(event[1])
    on = _ON_CHANNEL.fullmatch(event[2])
    if on is not None:
        return _on_channel(stamp, int(on[1]), on[3], head.account)
    word = re.match(rb"[a-z]*", event[2].lower())
    if not word or not word[0]:
        raise ValueError("no event")
    bus = next((name for begin, name in BUSES if begin.match(event[2])), None)
    others[f"objects of {bus}" if bus else KINDS.get(word[0], "other events")] += 1
    return None


def _on_channel(stamp: float, channel: int, text: bytes, account: Account) -> Frame | None:
    lower = text.lower()
    if lower.startswith(b"errorframe"):
        return error_frame(stamp, channel)
    if lower.startswith(b"statistic"):
        account.others["bus statistics"] += 1
    elif lower.startswith((b"overloadframe", b"overload frame")):
        account.others["overload frames"] += 1
    elif _REQUEST.fullmatch(text):
        account.others["requests to send"] += 1
    elif re.match(rb"\S+\s+(Rx|Tx)\b", text, re.IGNORECASE) or not text[:1].isalpha():
        raise ValueError("no frame")
    else:
        account.others["other events"] += 1
    return None
