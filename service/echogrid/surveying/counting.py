"""What the bits of frames do over time: counters, numbers of pages, checksums. No name is looked at here but to choose among equals."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import fastcrc

from echogrid.can.database import Message, Signal
from echogrid.can.dbc import Checksum
from echogrid.can.decode import fits, layout_of
from echogrid.surveying.words import is_checksum

SURE = 0.8  # share of the steps, or frames, that must agree
TRIED = 40  # frames that an algorithm must be right on
LEAST = 5


def integers(message: Message) -> list[Signal]:
    """Signals that are in every frame and can count."""
    return [
        s
        for s in message.signals
        if not s.is_float and s.selected_by is None and s.name not in message.unread and fits(s, message.length) and s.scale != 0
    ]


def raw(signal: Signal, payloads: Sequence[bytes]) -> list[int]:
    layout = layout_of(signal)
    return [layout.raw(payload) for payload in payloads]


def counts_up(signal: Signal, values: Sequence[int]) -> float:
    """Share of the steps that are one up, modulo the signal's bits or from a smaller end to 0."""
    if len(values) < LEAST or signal.length < 2 or signal.is_signed:
        return 0.0
    top = max(values)
    ups = sum(b == a + 1 or (b in (0, 1) and a == top and top > 1) for a, b in pairwise(values))
    return ups / (len(values) - 1)


def counter_of(message: Message, payloads: Sequence[bytes], widest: bool = False) -> Signal | None:
    """The signal that counts this message's frames."""
    scored = [(counts_up(s, raw(s, payloads)), s) for s in integers(message) if s.length <= 32]
    sure = [(s.length if widest else -s.length, share, s.name, s) for share, s in scored if share >= SURE]
    return max(sure)[-1] if sure else None


def algorithms(width: int) -> list[str]:
    """All checksums of a width that are known, the usual ones first."""
    module = {8: fastcrc.crc8, 16: fastcrc.crc16, 32: fastcrc.crc32}.get(width)
    return [] if module is None else [f"crc{width}.{name}" for name in sorted(module.algorithms_available)]


def checksum_of(message: Message, payloads: Sequence[bytes], summed: Sequence[bytes] | None = None) -> tuple[Signal, str] | None:
    """A signal of whole bytes with the algorithm that it is the checksum of: of the frame's other bytes, and of `summed` after them.

    Those that are named so come first. None where none fits: a checksum of another kind.
    """
    whole = [s for s in integers(message) if s.length in (8, 16, 32) and not layout_of(s).shift and not s.is_signed]
    payloads = payloads[:TRIED]
    if len({bytes(p) for p in payloads}) < LEAST:
        return None
    for signal in sorted(whole, key=lambda s: not is_checksum(s)):
        layout = layout_of(signal)
        if len({layout.raw(p) for p in payloads}) < LEAST:
            continue
        for name in algorithms(signal.length):
            module, _, function = name.partition(".")
            check = Checksum(layout, getattr(getattr(fastcrc, module), function))
            held = sum(check.holds(p, None if summed is None else check.others(p) + summed[n]) for n, p in enumerate(payloads))
            if held >= SURE * len(payloads):
                return signal, name
    return None


def sums(message: Message, pairs: Sequence[tuple[bytes, bytes]]) -> tuple[str, str] | None:
    """A signal and an algorithm by which a message of its own holds the checksum of other bytes: (its payload, those bytes)."""
    pairs = pairs[:TRIED]
    if len(pairs) < LEAST:
        return None
    for signal in integers(message):
        layout = layout_of(signal)
        if signal.length not in (8, 16, 32) or layout.shift or len({layout.raw(p) for p, _ in pairs}) < LEAST:
            continue
        for name in algorithms(signal.length):
            module, _, function = name.partition(".")
            check = Checksum(layout, getattr(getattr(fastcrc, module), function))
            if sum(check.holds(payload, summed) for payload, summed in pairs) >= SURE * len(pairs):
                return signal.name, name
    return None
