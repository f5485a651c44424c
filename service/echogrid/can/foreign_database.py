"""ARXML, KCD and SYM files, read by cantools."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import cantools.database.can as cantools

from echogrid.can.database import Database, Message, Ranges, Signal
from echogrid.errors import EchogridError

READERS = {
    ".arxml": cantools.Database.add_arxml_string,
    ".kcd": cantools.Database.add_kcd_string,
    ".sym": cantools.Database.add_sym_string,
}


def parse(path: Path, data: bytes) -> Database:
    """The messages of a file with one of those endings. Raises EchogridError where cantools does not read it."""
    logging.getLogger("cantools").setLevel(logging.ERROR)  # of names that are there twice we say so ourselves, where they are used
    suffix = path.suffix.lower()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
    database = cantools.Database(strict=False)
    try:
        READERS[suffix](database, text)
    except Exception as error:  # cantools lets errors of its parser's inside through: KeyError, ValueError, AttributeError
        reason = " ".join(str(error).split()) or type(error).__name__
        raise EchogridError(f"{path}: is not a {suffix[1:].upper()} file that cantools reads: {reason[:300]}") from error
    return Database(tuple(message_of(message) for message in database.messages))


def message_of(message: cantools.Message) -> Message:
    """A message of cantools' as one of ours."""
    fault = f"message '{message.name}' is a container of others" if message.is_container else None
    unread, signals = {}, []
    for signal in message.signals:
        if not _is_linear(signal):
            unread[signal.name] = f"'{signal.name}' is no linear function of its bits"
            continue
        signals.append(
            Signal(
                signal.name,
                signal.start,
                signal.length,
                is_motorola=signal.byte_order == "big_endian",
                is_signed=signal.is_signed,
                scale=signal.scale,
                offset=signal.offset,
                is_float=signal.is_float,
                selected_by=signal.multiplexer_signal,
                ids=None if signal.multiplexer_ids is None else ranges(signal.multiplexer_ids),
                unit=(signal.unit or "").strip(),
            )
        )
    return Message(message.name, message.frame_id, message.is_extended_frame, message.length, tuple(signals), fault, unread)


def ranges(numbers: Iterable[int]) -> Ranges:
    """Runs of numbers that follow one another."""
    ordered = sorted(set(numbers))
    breaks = [index for index, (one, other) in enumerate(pairwise(ordered), 1) if other != one + 1]
    return tuple((ordered[a], ordered[b - 1]) for a, b in zip([0, *breaks], [*breaks, len(ordered)], strict=True)) if ordered else ()


def _is_linear(signal: cantools.Signal) -> bool:
    """Whether cantools' own conversion agrees with scale and offset, at three raw values."""
    return all(signal.conversion.raw_to_scaled(raw, False) == raw * signal.scale + signal.offset for raw in (0, 1, 3))
