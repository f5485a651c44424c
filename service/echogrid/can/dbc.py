"""Databases of CAN messages: loading them, and finding what a profile names in them."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import fastcrc

from echogrid.can import dbc_file, e2e
from echogrid.can.database import Database, Message, Signal, overlap
from echogrid.can.decode import SignalLayout, fits, layout_of
from echogrid.errors import EchogridError
from echogrid.files import read

log = logging.getLogger("echogrid")

LONGEST = 64  # bytes of a frame
MOST_BYTES = 16 << 20
FOREIGN = (".arxml", ".kcd", ".sym")
MOST_SAID = 3  # of what is left out


class Dbc:
    """A loaded database; whatever it does not have, or not soundly, is an EchogridError that names file, message and signal."""

    def __init__(self, path: Path, profile: Path) -> None:
        self.path = path
        self.profile = profile
        self.database = _load(path, read(path, MOST_BYTES))

    def message(self, name: str, key: str) -> Message:
        """The message of that name; `key` is where the profile asks for it."""
        found = self.database.named(name)
        if not found:
            raise EchogridError(f"{self.profile}: {key}: {self.path} has no message '{name}'")
        for message in found:
            if message.fault is not None:
                raise EchogridError(f"{self.path}: {message.fault}")
        if len(found) > 1:
            ids = " and ".join(f"0x{message.frame_id:X}" for message in found)
            raise EchogridError(f"{self.path}: message '{name}' is there {len(found)} times, with the ids {ids}, expected once")
        message = found[0]
        if message.length > LONGEST:
            raise EchogridError(f"{self.path}: message '{name}' has {message.length} bytes, expected at most {LONGEST}, as CAN FD has")
        return message

    def signal(self, message: Message, name: str, key: str) -> list[Signal]:
        """The signals of that name, in as many branches as there are."""
        found = message.named(name)
        if not found and name not in message.unread:
            raise EchogridError(f"{self.profile}: {key}: message '{message.name}' of {self.path} has no signal '{name}'")
        self._check_bits(message, name, found)
        for one, other in combinations(found, 2):
            if one.selected_by is None or one.selected_by != other.selected_by or overlap(one.ids or (), other.ids or ()):
                raise EchogridError(
                    f"{self.path}: message '{message.name}' has signal '{name}' twice, not in branches that exclude each other"
                )
        for signal in found:
            self._check_selectors(message, signal)
        return found

    def _check_selectors(self, message: Message, signal: Signal) -> None:
        seen = {signal.name}
        selector = signal.selected_by
        while selector is not None:
            one = message.named(selector)
            if len(one) != 1 or selector in seen or one[0].is_float:
                raise EchogridError(f"{self.path}: message '{message.name}': no signal decides when '{signal.name}' is there")
            self._check_bits(message, selector, one)
            seen.add(selector)
            selector = one[0].selected_by

    def _check_bits(self, message: Message, name: str, signals: list[Signal]) -> None:
        if name in message.unread:
            raise EchogridError(f"{self.path}: message '{message.name}': {message.unread[name]}")
        for signal in signals:
            if not fits(signal, message.length):
                raise EchogridError(
                    f"{self.path}: message '{message.name}': signal '{signal.name}' of {signal.length} bits from bit {signal.start} on "
                    f"is not a number within its {message.length} bytes"
                )
            if signal.scale == 0:
                raise EchogridError(f"{self.path}: message '{message.name}': signal '{signal.name}' has the scale 0: it says nothing")

    def integer(self, message: Message, name: str, key: str) -> SignalLayout:
        """The layout of a signal that counts or flags something."""
        signals = self.signal(message, name, key)
        if signals[0].selected_by is not None:
            raise EchogridError(f"{self.profile}: {key}: '{name}' of {self.path} is multiplexed, expected a signal that is in every frame")
        layout = layout_of(signals[0])
        if layout.is_float:
            raise EchogridError(f"{self.profile}: {key}: '{name}' of {self.path} is a float, expected an integer signal")
        return layout

    def checksum(self, message: Message, name: str, algorithm: str, key: str, data_id: tuple[int, ...] = ()) -> Checksum:
        """A checksum in a signal of the message, which must fill whole bytes."""
        layout = self.integer(message, name, key)
        if layout.shift or layout.length % 8:
            raise EchogridError(f"{self.profile}: {key}: '{name}' of {self.path} does not fill whole bytes")
        if algorithm in e2e.ALGORITHMS:
            return self._end_to_end(message, layout, algorithm, key, data_id)
        if data_id:
            raise EchogridError(f"{self.profile}: {key}.data_id: '{algorithm}' has none, expected one of {', '.join(e2e.ALGORITHMS)}")
        module, _, function = algorithm.partition(".")
        known = {"crc8": fastcrc.crc8, "crc16": fastcrc.crc16, "crc32": fastcrc.crc32}
        compute = getattr(known.get(module), function, None) if function in _algorithms(known.get(module)) else None
        if compute is None:
            raise EchogridError(f"{self.profile}: {key}: '{algorithm}' is not a known checksum, expected one such as crc8.sae_j1850")
        return Checksum(layout, compute)

    def _end_to_end(self, message: Message, layout: SignalLayout, algorithm: str, key: str, data_id: tuple[int, ...]) -> Checksum:
        place = first_byte(layout)
        if place + layout.length // 8 >= message.length:
            raise EchogridError(f"{self.profile}: {key}: nothing is behind the checksum of '{message.name}', expected the counter")
        try:
            return Checksum(layout, e2e.checksum(algorithm, data_id, layout.length, place))
        except ValueError as error:
            raise EchogridError(f"{self.profile}: {key}: {error}") from error


class Checksum:
    """Where a checksum is in a frame, and how it is computed."""

    def __init__(self, layout: SignalLayout, compute: Callable[[bytes], int]) -> None:
        self.layout = layout
        self.compute = compute
        first = first_byte(layout)
        self.place = first, first + layout.length // 8  # of its bytes: the first, and the first behind it

    def others(self, payload: bytes) -> bytes:
        """The payload without the checksum's own bytes."""
        return payload[: self.place[0]] + payload[self.place[1] :]

    def holds(self, payload: bytes, summed: bytes | None = None) -> bool:
        """Whether the payload's checksum is that of `summed` (default: of the payload's other bytes)."""
        return self.compute(self.others(payload) if summed is None else summed) == self.layout.raw(payload)


def first_byte(layout: SignalLayout) -> int:
    """Where a signal of whole bytes begins."""
    return layout.lsb_byte if layout.step > 0 else layout.lsb_byte - layout.length // 8 + 1


def _algorithms(module: object) -> frozenset[str]:
    return frozenset(getattr(module, "algorithms_available", ()))


def forget() -> None:
    """Lets go of all files that were read: a car's own database takes tens of MiB, of which its readers keep a few messages."""
    _load.cache_clear()


@lru_cache(maxsize=8)  # several radars share a file, and what it leaves out is said once
def _load(path: Path, data: bytes) -> Database:
    if path.suffix.lower() in FOREIGN:
        from echogrid.can import foreign_database  # cantools takes 0.2 s to import, and few have such a file

        database = foreign_database.parse(path, data)
    else:
        database = dbc_file.parse(data)
    if not database.messages:
        why = f": {database.left_out[0]}" if database.left_out else ""
        what = f"{path.suffix[1:].upper()} file with messages" if path.suffix.lower() in FOREIGN else "DBC file: it has no message (BO_)"
        raise EchogridError(f"{path}: is no {what}{why}")
    if database.left_out:
        more = len(database.left_out) - MOST_SAID
        said = "; ".join(database.left_out[:MOST_SAID]) + (f"; and {more} more lines" if more > 0 else "")
        log.warning("%s: what cannot be read is left out: %s", path, said)
    return database
