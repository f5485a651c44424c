"""Logs of can-utils (`candump -l`, `-L`), and what candump shows on a terminal where it was asked for times."""

from __future__ import annotations

import re
from binascii import unhexlify
from collections.abc import Iterator
from datetime import UTC, datetime
from functools import partial

from echogrid.can.intake.frames import Frame, FrameBatch
from echogrid.core.kernels.dispatch import loops
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.stream import Stream
from echogrid.logs.formats.times import timely
from echogrid.logs.text.lines import Columns, read_lines

ERROR, EXTENDED = 0x20000000, 0x1FFFFFFF
_TIME = rb"\s*\(\s*([\d.: -]{3,40})\)\s+"
_ODD_FRAME = re.compile(  # what one writes less often: dots between bytes, remote frames, the length code of more than 8 bytes, a date
    _TIME + rb"(\S{1,64})\s+([0-9A-Fa-f]{3,8})#(#[0-9A-Fa-f])?(?:([Rr])([0-8]?)|([0-9A-Fa-f.]*))(?:_[9A-Fa-f])?(?:\s+([RrTt]))?\s*"
)
_SHOWN = re.compile(
    _TIME + rb"(\S{1,64})\s+(?:([RT]X)\s+\S+\s+\S+\s+)?([0-9A-F]{3}|[0-9A-F]{8})\s+\[(\d{1,2})\]\s*((?:\s[0-9A-F]{2})*|\s*remote request)"
    rb"\s*(?:'.*'?|ERRORFRAME.*)?\s*"
)
_XL = re.compile(_TIME + rb"\S+\s+[0-9A-Fa-f]{3,8}#[0-9A-Fa-f]{2}:[0-9A-Fa-f]{2}:[0-9A-Fa-f]{8}#.*")
_DATED = re.compile(r"(\d{4}-\d{2}-\d{2} \d{2}:\d{2}:\d{2})\.(\d{1,9})")


def read(stream: Stream, account: Account) -> Iterator[FrameBatch]:
    """The frames. An id of more than three digits has 29 bits."""
    yield from read_lines(stream, account, _plain, partial(_other, account=account))


def _plain(columns: Columns, text: bytes) -> None:
    loops.candump_lines(*columns.arguments(text), columns.name_rows())


def _other(line: bytes, number: int, *, account: Account) -> Frame | None:
    """A line that is no plain data frame: what it is, or what the account is told of it."""
    text = line.strip()
    if not text:
        return None
    if text.startswith((b"#", b";", b"//")) or line.startswith(b"\t"):  # a tab: candump -e explains the error frame above
        account.others["comments"] += 1
    elif text.startswith(b"DROPCOUNT"):
        account.others["notices of dropped frames"] += 1
        account.note(f"its recorder says that it lost frames: '{text.decode('ascii', 'backslashreplace')[:100]}'")
    elif _XL.fullmatch(line):
        account.others["CAN XL frames"] += 1
    else:
        try:
            return account.kind(_written(line) or _shown(line))
        except ValueError as error:
            account.line(number, line, error)
    return None


def _written(line: bytes) -> Frame | None:
    found = _ODD_FRAME.fullmatch(line)
    if found is None:
        return None
    time, channel, identifier, fd, remote, length, payload, way = found.groups()
    data = unhexlify((payload or b"").replace(b".", b""))
    frame = _message(time, channel, identifier, remote is not None, data)
    if remote is not None:
        frame.dlc = int(length or b"0")
    if fd is not None:
        flags = int(fd[1:], 16)
        frame.is_fd, frame.bitrate_switch, frame.error_state_indicator = True, flags & 1 != 0, flags & 2 != 0
    frame.is_rx = way is None or way in b"Rr"
    if len(data) > (8 if fd is None else 64):
        raise ValueError("too much data")
    return frame


def _shown(line: bytes) -> Frame:
    found = _SHOWN.fullmatch(line)
    if found is None:
        raise ValueError("no frame")
    time, channel, way, identifier, length, payload = found.groups()
    remote = payload.endswith(b"request")
    data = b"" if remote else unhexlify(b"".join(payload.split()))
    frame = _message(time, channel, identifier, remote, data)
    frame.dlc, frame.is_fd, frame.is_rx = int(length), len(length) == 2, way != b"TX"
    if frame.dlc > (64 if frame.is_fd else 8) or (not remote and frame.dlc != len(data)):
        raise ValueError("its length is another")
    return frame


def _message(time: bytes, channel: bytes, identifier: bytes, remote: bool, data: bytes) -> Frame:
    stamp, code = _stamp(time.decode().strip()), int(identifier, 16)
    failed = len(identifier) == 8 and code & ERROR != 0 and not remote
    if code & ~EXTENDED and not failed:
        raise ValueError("no id")
    name = channel.decode("ascii", "backslashreplace")
    return Frame(stamp, code & EXTENDED, len(identifier) > 3, remote, failed, name, len(data), data)


def _stamp(text: str) -> float:
    """Seconds; of a date (`candump -t A`), which is the recorder's local time, those since 1970 as if it were UTC."""
    dated = _DATED.fullmatch(text)
    if dated is None:
        return timely(float(text))
    return timely(datetime.strptime(dated[1], "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC).timestamp() + float(f"0.{dated[2]}"))
