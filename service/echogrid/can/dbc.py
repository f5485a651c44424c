"""DBC files: loading them, and finding what a profile names in them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import fastcrc
from cantools.database.can import Database, Message
from cantools.database.can import Signal as DbcSignal

from echogrid.can.decode import SignalLayout, fits, layout_of
from echogrid.errors import EchogridError
from echogrid.files import read

LONGEST = 64  # bytes of a frame
MOST_BYTES = 16 << 20
ABSURD = re.compile(r"SG_\s+\w+\s+(?:[mM]\w*\s*)?:\s*(?:\d{6,}\s*\||\d+\s*\|\s*\d{6,}\s*@)")  # a signal's start or length


class Dbc:
    """A loaded DBC file; whatever it does not have is an EchogridError that names file, message and signal."""

    def __init__(self, path: Path, profile: Path) -> None:
        self.path = path
        self.profile = profile
        self.database = _load(path)

    def message(self, name: str, key: str) -> Message:
        """The message of that name; `key` is where the profile asks for it."""
        try:
            message = self.database.get_message_by_name(name)
        except KeyError:
            raise EchogridError(f"{self.profile}: {key}: {self.path} has no message '{name}'") from None
        if message.length > LONGEST:
            raise EchogridError(f"{self.path}: message '{name}' has {message.length} bytes, expected at most {LONGEST}, as CAN FD has")
        return message

    def signal(self, message: Message, name: str, key: str) -> DbcSignal:
        by_name = {signal.name: signal for signal in message.signals}
        if name not in by_name:
            raise EchogridError(f"{self.profile}: {key}: message '{message.name}' of {self.path} has no signal '{name}'")
        chain = [by_name[name]]
        while (selector := chain[-1].multiplexer_signal) is not None:
            if selector not in by_name or by_name[selector] in chain:
                raise EchogridError(f"{self.path}: message '{message.name}': no signal says when '{name}' is present")
            chain.append(by_name[selector])
        for signal in chain:
            if not fits(signal, message.length):
                raise EchogridError(
                    f"{self.path}: message '{message.name}': signal '{signal.name}' of {signal.length} bits from bit {signal.start} on "
                    f"is not a number within its {message.length} bytes"
                )
        return by_name[name]

    def integer(self, message: Message, name: str, key: str) -> SignalLayout:
        """The layout of a signal that counts or flags something."""
        layout = layout_of(self.signal(message, name, key))
        if layout.is_float:
            raise EchogridError(f"{self.profile}: {key}: '{name}' of {self.path} is a float, expected an integer signal")
        return layout

    def checksum(self, message: Message, name: str, algorithm: str, key: str) -> Checksum:
        """A checksum in a signal of the message, which must fill whole bytes."""
        layout = self.integer(message, name, key)
        if layout.shift or layout.length % 8:
            raise EchogridError(f"{self.profile}: {key}: '{name}' of {self.path} does not fill whole bytes")
        module, _, function = algorithm.partition(".")
        known = {"crc8": fastcrc.crc8, "crc16": fastcrc.crc16, "crc32": fastcrc.crc32}
        compute = getattr(known.get(module), function, None) if function in _algorithms(known.get(module)) else None
        if compute is None:
            raise EchogridError(f"{self.profile}: {key}: '{algorithm}' is not a known checksum, expected one such as crc8.sae_j1850")
        return Checksum(layout, compute)


class Checksum:
    """Where a checksum is in a frame, and how it is computed."""

    def __init__(self, layout: SignalLayout, compute: Callable[[bytes], int]) -> None:
        self.layout = layout
        self.compute = compute
        count = layout.length // 8
        self._first = layout.lsb_byte if layout.step > 0 else layout.lsb_byte - count + 1
        self._after = self._first + count

    def others(self, payload: bytes) -> bytes:
        """The payload without the checksum's own bytes."""
        return payload[: self._first] + payload[self._after :]

    def holds(self, payload: bytes, summed: bytes | None = None) -> bool:
        """Whether the payload's checksum is that of `summed` (default: of the payload's other bytes)."""
        return self.compute(self.others(payload) if summed is None else summed) == self.layout.raw(payload)


def _algorithms(module: object) -> frozenset[str]:
    return frozenset(getattr(module, "algorithms_available", ()))


def _load(path: Path) -> Database:
    text = read(path, MOST_BYTES).decode("cp1252", errors="replace")
    if ABSURD.search(text):  # cantools makes masks as wide
        raise EchogridError(f"{path}: a signal starts at bit 100000 or later, or has so many")
    try:
        database = Database(strict=False)
        database.add_dbc_string(text)
        return database
    except Exception as error:  # cantools lets errors of its parser's inside through: KeyError, ValueError, AttributeError
        raise EchogridError(f"{path}: is not a DBC file that cantools reads: {error}") from error
