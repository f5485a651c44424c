"""Logs of can-utils (`candump -l`, `-L`), and what candump shows on a terminal where it was asked for times."""

from __future__ import annotations

import re
from binascii import unhexlify
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import repeat, starmap

from echogrid.logs.formats.account import Account
from echogrid.logs.formats.frame import Frame
from echogrid.logs.formats.stream import Stream
from echogrid.logs.formats.times import END_OF_TIME

ERROR, EXTENDED = 0x20000000, 0x1FFFFFFF
FLAGS = {"": 0} | {digit: int(digit, 16) for digit in "0123456789ABCDEFabcdef"}  # behind ##; none for a classic frame
SWITCHING, PASSIVE = ({digit: flags & bit != 0 for digit, flags in FLAGS.items()} for bit in (1, 2))
_FRAME = re.compile(rb"\s*\(\d{1,10}\.\d{1,9}\)\s+\S{1,64}\s+[0-9A-Fa-f]{3,8}#(?:#[0-9A-Fa-f])?[0-9A-Fa-f]*(?:\s+[RrTt])?\s*")
_NO_DIGITS = str.maketrans("", "", "0123456789")
MOST_PLAIN = 512  # bytes of a line
_ID = re.compile("[0-9A-Fa-f]{3,8}")
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


def read(stream: Stream, account: Account) -> Iterator[list[Frame]]:
    """The frames, in groups. An id of more than three digits has 29 bits."""
    codes: dict[str, int] = {}  # ids by their digits: there are few
    for first, lines in stream.lines():
        frames = _plain(lines, codes)
        yield _mixed(first, lines, codes, account) if frames is None else frames


def _mixed(first: int, lines: list[bytes], codes: dict[str, int], account: Account) -> list[Frame]:
    """Runs of plain lines, and what lies between them."""
    frames: list[Frame] = []
    run: list[bytes] = []
    for number, line in enumerate(lines, first):
        if _FRAME.fullmatch(line) and len(line) < MOST_PLAIN:
            run.append(line)
            continue
        frames += _run(number - len(run), run, codes, account)
        run = []
        if (frame := _other(line, number, account)) is not None:
            frames.append(frame)
    return frames + _run(first + len(lines) - len(run), run, codes, account)


def _run(first: int, lines: list[bytes], codes: dict[str, int], account: Account) -> list[Frame]:
    frames = _plain(lines, codes)
    if frames is not None:
        return frames
    frames = []
    for number, line in enumerate(lines, first):
        one = _plain([line], codes)
        if one is None and (other := _other(line, number, account)) is not None:
            one = [other]
        frames += one or []
    return frames


def _plain(lines: list[bytes], codes: dict[str, int]) -> list[Frame] | None:
    """The frames of lines that are all plain data frames, column by column; None where one may be something else."""
    words = b"\n".join(lines).decode("latin-1").split()
    step = len(words) // max(len(lines), 1)
    if not words:
        return [] if not lines else None
    if step not in (3, 4) or len(words) != step * len(lines):
        return None
    times, names, frames = words[0::step], words[1::step], words[2::step]
    ways = words[3::4] if step == 4 else []
    if "".join(times).translate(_NO_DIGITS) != "(.)" * len(lines) or set(ways) - {"R", "T", "r", "t"}:
        return None
    identifiers, marks, tails = zip(*[frame.partition("#") for frame in frames], strict=True)
    if set(marks) != {"#"}:
        return None
    for digits in set(identifiers) - codes.keys():
        if not _ID.fullmatch(digits) or int(digits, 16) > EXTENDED:
            return None
        codes[digits] = int(digits, 16)
    try:
        stamps = list(map(float, "".join(times)[1:-1].split(")(")))
        flags = [tail[1:2] or "?" if tail[:1] == "#" else "" for tail in tails]
        fd, switch, state = list(map(bool, flags)), list(map(SWITCHING.__getitem__, flags)), list(map(PASSIVE.__getitem__, flags))
        data = [bytearray.fromhex(tail[2:] if flexible else tail) for tail, flexible in zip(tails, fd, strict=True)]
    except (ValueError, KeyError):
        return None
    lengths = list(map(len, data))
    if max(stamps) >= END_OF_TIME or max(lengths) > 64 or (max(lengths) > 8 and _too_long(lengths, fd)):
        return None
    no: Iterator[bool] = repeat(False)
    received = [way in "Rr" for way in ways] if ways else repeat(True)
    extended = [len(digits) > 3 for digits in identifiers]
    columns = (stamps, map(codes.__getitem__, identifiers), extended, no, no, names, lengths, data, fd, received, switch, state)
    return list(starmap(Frame, zip(*columns)))  # noqa: B905  # some columns have no end


def _too_long(lengths: list[int], fd: list[bool]) -> bool:
    return any(length > 8 and not flexible for length, flexible in zip(lengths, fd, strict=True))


def _other(line: bytes, number: int, account: Account) -> Frame | None:
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
            return _written(line, account) or _shown(line, account)
        except ValueError:
            account.line(number, line)
    return None


def _written(line: bytes, account: Account) -> Frame | None:
    found = _ODD_FRAME.fullmatch(line)
    if found is None:
        return None
    time, channel, identifier, fd, remote, length, payload, way = found.groups()
    data = unhexlify((payload or b"").replace(b".", b""))
    frame = _message(time, channel, identifier, remote is not None, data, account)
    if remote is not None:
        frame.dlc = int(length or b"0")
    if fd is not None:
        flags = int(fd[1:], 16)
        frame.is_fd, frame.bitrate_switch, frame.error_state_indicator = True, flags & 1 != 0, flags & 2 != 0
    frame.is_rx = way is None or way in b"Rr"
    if len(data) > (8 if fd is None else 64):
        raise ValueError("too much data")
    return frame


def _shown(line: bytes, account: Account) -> Frame:
    found = _SHOWN.fullmatch(line)
    if found is None:
        raise ValueError("no frame")
    time, channel, way, identifier, length, payload = found.groups()
    remote = payload.endswith(b"request")
    data = b"" if remote else unhexlify(b"".join(payload.split()))
    frame = _message(time, channel, identifier, remote, data, account)
    frame.dlc, frame.is_fd, frame.is_rx = int(length), len(length) == 2, way != b"TX"
    if frame.dlc > (64 if frame.is_fd else 8) or (not remote and frame.dlc != len(data)):
        raise ValueError("its length is another")
    return frame


def _message(time: bytes, channel: bytes, identifier: bytes, remote: bool, data: bytes, account: Account) -> Frame:
    stamp, code = _stamp(time.decode().strip()), int(identifier, 16)
    failed = len(identifier) == 8 and code & ERROR != 0 and not remote
    if code & ~EXTENDED and not failed:
        raise ValueError("no id")
    account.remote += remote
    account.errors += failed
    name = channel.decode("ascii", "backslashreplace")
    return Frame(stamp, code & EXTENDED, len(identifier) > 3, remote, failed, name, len(data), bytearray(data))


def _stamp(text: str) -> float:
    """Seconds; of a date (`candump -t A`), which is the recorder's local time, those since 1970 as if it were UTC."""
    dated = _DATED.fullmatch(text)
    if dated is None:
        stamp = float(text)
    else:
        stamp = datetime.strptime(dated[1], "%Y-%m-%d %H:%M:%S").replace(tzinfo=UTC).timestamp() + float(f"0.{dated[2]}")
    if not 0 <= stamp < END_OF_TIME:
        raise ValueError("no time")
    return stamp
