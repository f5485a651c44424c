"""Comma-separated values: python-can's, which says no channels, and SavvyCAN's native format (GVRET)."""

from __future__ import annotations

import re
from base64 import b64decode
from binascii import a2b_base64, unhexlify
from collections.abc import Callable, Iterator
from itertools import repeat, starmap

from can.util import dlc2len

from echogrid.logs.formats.account import Account
from echogrid.logs.formats.frame import Frame
from echogrid.logs.formats.stream import Stream
from echogrid.logs.formats.times import END_OF_TIME

EXTENDED = 0x1FFFFFFF
LENGTHS = {str(length): (length, dlc2len(length)) for length in range(65)}  # what may stand under dlc: bytes, or CAN FD's code for them
_PYTHON_CAN = re.compile(
    rb"\s*(\d{1,10}(?:\.\d{1,12})?(?:e[+-]?\d{1,2})?),(0x[0-9a-f]{1,8}|[0-9a-f]{1,8}),([01]),([01]),([01]),(\d{1,2}),([A-Za-z0-9+/=]*)\s*",
    re.IGNORECASE,
)
_GVRET = re.compile(
    rb"\s*(\d{1,20}(?:\.\d{1,9})?),(?:0x)?([0-9a-f]{1,8}),(true|false|0|1),(?:(Rx|Tx),)?(\d{1,3}),(\d{1,2})((?:,[0-9a-f]{0,2})*)[,\s]*",
    re.IGNORECASE,
)
Parse = Callable[[bytes, Account], Frame | None]


def read(stream: Stream, account: Account) -> Iterator[list[Frame]]:
    """The frames, in groups. Raises ValueError where the first line is of neither format."""
    parse: Parse | None = None
    codes: dict[str, int] = {}
    for first, lines in stream.lines():
        if parse is _python_can and (plain := _plain(lines, codes)) is not None:
            yield plain
            continue
        frames = []
        for number, line in enumerate(lines, first):
            if not line.strip():
                continue
            if parse is None:
                parse, is_head = _format(line)
                if is_head:
                    continue
            try:
                frame = parse(line, account)
            except ValueError:
                frame = None
            if frame is None:
                account.line(number, line)
            else:
                frames.append(frame)
        yield frames


def _plain(lines: list[bytes], codes: dict[str, int]) -> list[Frame] | None:
    """The frames of python-can's lines that are all data frames, column by column; None where one is not."""
    words = b",".join(lines).decode("latin-1").split(",")
    if len(words) != 7 * len(lines) or set(words[3::7]) | set(words[4::7]) != {"0"} or not {"0", "1"}.issuperset(words[2::7]):
        return None
    for digits in set(words[1::7]) - codes.keys():
        if not re.fullmatch("(0x)?[0-9a-fA-F]{1,8}", digits) or int(digits, 16) > EXTENDED:
            return None
        codes[digits] = int(digits, 16)
    try:
        stamps = list(map(float, words[0::7]))
        payloads = [a2b_base64(word, strict_mode=True) if word else b"" for word in words[6::7]]
        sizes = list(map(LENGTHS.__getitem__, words[5::7]))
    except (ValueError, KeyError):
        return None
    lengths = list(map(len, payloads))
    if any(length not in size for length, size in zip(lengths, sizes, strict=True)) or not 0 <= min(stamps) <= max(stamps) < END_OF_TIME:
        return None
    wide = [word == "1" for word in words[2::7]]
    no = repeat(False)
    columns = (stamps, map(codes.__getitem__, words[1::7]), wide, no, no, repeat(None), lengths, payloads)
    return list(starmap(Frame, zip(*columns)))  # noqa: B905  # some columns have no end


def _format(line: bytes) -> tuple[Parse, bool]:
    """How the lines are to be read, and whether this one is the head."""
    head = line.lower().replace(b" ", b"").replace(b'"', b"")
    if head.startswith(b"timestamp,arbitration_id,"):
        return _python_can, True
    if head.startswith(b"timestamp,id,extended,"):
        return _gvret, True
    for parse, pattern in ((_python_can, _PYTHON_CAN), (_gvret, _GVRET)):
        if pattern.fullmatch(line):
            return parse, False
    shown = line[:100].decode("ascii", "backslashreplace").strip()
    raise ValueError(
        f"its columns are '{shown}', expected python-can's (timestamp,arbitration_id,extended,remote,error,dlc,data) "
        "or SavvyCAN's (Time Stamp,ID,Extended,Dir,Bus,LEN,D1,…)"
    )


def _python_can(line: bytes, account: Account) -> Frame | None:
    found = _PYTHON_CAN.fullmatch(line)
    if found is None:
        return None
    time, identifier, extended, remote, error, dlc, payload = found.groups()
    stamp, code, length, data = float(time), int(identifier, 16), int(dlc), b64decode(payload, validate=True)
    if stamp >= END_OF_TIME or code > EXTENDED or len(data) > 64:
        return None
    failed, asked = error == b"1", remote == b"1"
    if not (failed or asked) and len(data) not in (length, dlc2len(length)):
        return None
    account.remote += asked
    account.errors += failed
    length = length if asked or failed else len(data)
    return Frame(stamp, code, extended == b"1", asked, failed, None, length, data)


def _gvret(line: bytes, account: Account) -> Frame | None:
    """Times are microseconds; SavvyCAN's bus 0 is called can0, as its window does."""
    found = _GVRET.fullmatch(line)
    if found is None:
        return None
    time, identifier, extended, way, bus, count, rest = found.groups()
    stamp = float(time) if b"." in time else int(time) / 1e6
    code, length = int(identifier, 16) & ~0x80000000, int(count)
    wide = extended.lower() in (b"true", b"1")
    words = rest.split(b",")[1 : 1 + length]
    data = unhexlify(b"".join(word.zfill(2) for word in words))
    if stamp >= END_OF_TIME or code > (EXTENDED if wide else 0x7FF) or not length == len(data) <= 64 or b"" in words:
        return None
    channel = f"can{int(bus)}"
    return Frame(stamp, code, wide, False, False, channel, length, data, length > 8, way is None or way.lower() == b"rx")
