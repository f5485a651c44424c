"""Comma-separated values: python-can's, which says no channels, and SavvyCAN's native format (GVRET)."""

from __future__ import annotations

import re
from base64 import b64decode
from binascii import unhexlify
from collections.abc import Callable, Iterator

from can.util import dlc2len

from echogrid.can.intake.frames import Frame, FrameBatch
from echogrid.core.kernels.dispatch import loops
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.stream import Stream
from echogrid.logs.formats.times import timely
from echogrid.logs.text.lines import Columns, read_lines

EXTENDED = 0x1FFFFFFF
_PYTHON_CAN = re.compile(
    rb"\s*(\d{1,10}(?:\.\d{1,12})?(?:e[+-]?\d{1,2})?),(0x[0-9a-f]{1,8}|[0-9a-f]{1,8}),([01]),([01]),([01]),(\d{1,2}),([A-Za-z0-9+/=]*)\s*",
    re.IGNORECASE,
)
_GVRET = re.compile(
    rb"\s*(\d{1,20}(?:\.\d{1,9})?),(?:0x)?([0-9a-f]{1,8}),(true|false|0|1),(?:(Rx|Tx),)?(\d{1,3}),(\d{1,2})((?:,[0-9a-f]{0,2})*)[,\s]*",
    re.IGNORECASE,
)
Parse = Callable[[bytes, Account], Frame | None]


def read(stream: Stream, account: Account) -> Iterator[FrameBatch]:
    """The frames. Raises ValueError where the first line is of neither format."""
    table = _Table(account)
    yield from read_lines(stream, account, table.take, table.read)


class _Table:
    """Remembers which of the formats it is."""

    def __init__(self, account: Account) -> None:
        self.account = account
        self._parse: Parse | None = None

    def take(self, columns: Columns, text: bytes) -> None:
        """Lines of data frames, once the format is known."""
        if self._parse is _python_can:
            loops.csv_lines(*columns.arguments(text))

    def read(self, line: bytes, number: int) -> Frame | None:
        """A line's frame. Raises ValueError where the first one is of neither format."""
        if not line.strip():
            return None
        if self._parse is None:
            self._parse, is_head = _format(line)
            if is_head:
                return None
        try:
            frame, why = self._parse(line, self.account), None
        except ValueError as error:
            frame, why = None, error
        if frame is None:
            self.account.line(number, line, why)
        return frame


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
    stamp, code, length, data = timely(float(time)), int(identifier, 16), int(dlc), b64decode(payload, validate=True)
    if code > EXTENDED or len(data) > 64:
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
    stamp = timely(float(time) if b"." in time else int(time) / 1e6)
    code, length = int(identifier, 16) & ~0x80000000, int(count)
    wide = extended.lower() in (b"true", b"1")
    words = rest.split(b",")[1 : 1 + length]
    data = unhexlify(b"".join(word.zfill(2) for word in words))
    if code > (EXTENDED if wide else 0x7FF) or not length == len(data) <= 64 or b"" in words:
        return None
    channel = f"can{int(bus)}"
    return Frame(stamp, code, wide, False, False, channel, length, data, length > 8, way is None or way.lower() == b"rx")
