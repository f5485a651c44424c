"""Signals out of CAN payloads, many frames at once: a decoder compiled from the DBC.

Each signal is at most 64 bits somewhere in the payload: from the byte of its least significant bit on, upwards for Intel and downwards for
Motorola byte order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from echogrid.can.database import Message, Ranges, Signal
from echogrid.core.kernels.dispatch import loops

Payloads = NDArray[np.uint8]  # (N, bytes)
WORD = 8  # bytes read for a signal
MARGIN = WORD + 1  # zero bytes after a payload, so that no word leaves the row
EXACT = 2**53  # integers beyond do not fit a float64


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Where a signal's bits are, and what its raw value means: physical = raw * scale + offset.

    A scale or offset that is a Python int is computed exactly, as in cantools, and rounded only at the end.
    """

    lsb_byte: int
    step: int  # +1 Intel, -1 Motorola
    shift: int
    length: int
    is_signed: bool
    is_float: bool
    scale: float
    offset: float

    def raw(self, payload: bytes) -> int:
        """The signal's raw value in one payload. Only for integer signals."""
        if self.shift + self.length <= 8 and not self.is_signed:
            return payload[self.lsb_byte] >> self.shift & ((1 << self.length) - 1)
        if self.step > 0:
            word = int.from_bytes(payload[self.lsb_byte : self.lsb_byte + MARGIN], "little")
        else:
            word = int.from_bytes(payload[max(0, self.lsb_byte - WORD) : self.lsb_byte + 1], "big")
        value = word >> self.shift & ((1 << self.length) - 1)
        return value - (1 << self.length) if self.is_signed and value >> (self.length - 1) else value


Place = tuple[int, int, int, int, int]  # where an integer is, as the loops have it


def place_of(layout: SignalLayout | None) -> Place:
    """None: nowhere."""
    return (0, 1, 0, 0, 0) if layout is None else (layout.lsb_byte, layout.step, layout.shift, layout.length, int(layout.is_signed))


def layout_of(signal: Signal) -> SignalLayout:
    """The layout of a signal as its file describes it."""
    scale, offset = signal.scale, signal.offset
    if float(scale).is_integer() and float(offset).is_integer():
        scale, offset = int(scale), int(offset)
    if not signal.is_motorola:
        lsb, step = signal.start, 1
    else:
        lsb_in_order = _msb_in_order(signal) + signal.length - 1
        lsb, step = 8 * (lsb_in_order // 8) + 7 - lsb_in_order % 8, -1
    return SignalLayout(
        lsb_byte=lsb // 8,
        step=step,
        shift=lsb % 8,
        length=signal.length,
        is_signed=signal.is_signed and not signal.is_float,
        is_float=signal.is_float,
        scale=scale,
        offset=offset,
    )


def _msb_in_order(signal: Signal) -> int:
    """A Motorola signal's DBC start bit is its most significant bit; bits run down within a byte, bytes run up."""
    return 8 * (signal.start // 8) + 7 - signal.start % 8


def fits(signal: Signal, length: int) -> bool:
    """Whether the signal's layout is sound and lies within `length` bytes; files hold any."""
    lengths = (16, 32, 64) if signal.is_float else range(1, 65)
    first = _msb_in_order(signal) if signal.is_motorola else signal.start
    return (
        signal.length in lengths
        and 0 <= first <= 8 * length - signal.length
        and math.isfinite(signal.scale)
        and math.isfinite(signal.offset)
    )


def stack(payloads: Sequence[bytes], length: int) -> NDArray[np.uint8]:
    """Payloads of exactly `length` bytes as rows (N, length)."""
    return np.frombuffer(b"".join(payloads), dtype=np.uint8).reshape(-1, length)


class Decoded(NamedTuple):
    """What is in N payloads: (N, signals) each. `raw` is meaningless where not `there`, and for floats; wrapped for unsigned 64 bits."""

    physical: NDArray[np.float64]  # in the DBC's units, NaN where not there
    raw: NDArray[np.int64]
    there: NDArray[np.bool_]


class _Condition(NamedTuple):
    """The columns' signals are there where the selector's column has a value within one of the ranges."""

    columns: list[int]
    selector: int
    ids: Ranges


class BatchDecoder:
    """Decodes chosen signals of one message from many payloads: (N, length) uint8 in, (N, signals) float64 out.

    Equal bit for bit to cantools' numbers as float64. A signal that the payload's multiplexor leaves out is NaN; one that is defined in
    several branches is that of the branch which is there.
    """

    def __init__(self, message: Message, names: Iterable[str] | None = None) -> None:
        """Raises KeyError with the name of a signal that the message does not have."""
        self.names = tuple(dict.fromkeys(signal.name for signal in message.signals)) if names is None else tuple(names)
        self.length = message.length
        by_name = {signal.name: signal for signal in reversed(message.signals)}
        columns = [by_name[name] for name in self.names]
        self._branches: list[tuple[int, int]] = []  # column of a name, column of the same name in another branch
        for column, name in enumerate(self.names):
            for other in message.named(name)[1:]:
                self._branches.append((column, len(columns)))
                columns.append(other)
        place = {name: column for column, name in enumerate(self.names)}
        for signal in columns:  # grows with the selectors of selectors
            if signal.selected_by is not None and signal.selected_by not in place:
                place[signal.selected_by] = len(columns)
                columns.append(by_name[signal.selected_by])
        conditions: dict[tuple[int, Ranges], list[int]] = {}
        for column, signal in enumerate(columns):
            for above in _chain(signal, by_name):
                if above.selected_by is not None:
                    conditions.setdefault((place[above.selected_by], above.ids or ()), []).append(column)
        self._conditions = [_Condition(those, *condition) for condition, those in conditions.items()]
        self.layouts = tuple(layout_of(signal) for signal in columns)
        self._compile()

    @property
    def is_plain(self) -> bool:
        """Whether all signals are in every payload, and integers times a scale that floats hold."""
        special = self._floats or self._unsigned64 or self._big or self._conditions or self._branches
        return not special and len(self.names) == len(self.layouts)

    def _compile(self) -> None:
        layouts = self.layouts
        self._places = np.array([place_of(layout) for layout in layouts], dtype=np.int64).reshape(-1, 5)
        self._linear = np.array([(layout.scale, layout.offset) for layout in layouts], dtype=np.float64).reshape(-1, 2)
        self._floats = [(column, layout.length) for column, layout in enumerate(layouts) if layout.is_float]
        self._unsigned64 = [c for c, layout in enumerate(layouts) if layout.length == 64 and not layout.is_signed]
        self._big = [column for column, layout in enumerate(layouts) if _may_exceed_float(layout)]

    def decoded(self, payloads: NDArray[np.uint8]) -> Decoded:
        """All there is to say of the payloads."""
        shape = (len(payloads), len(self.layouts))
        bits, raw, values, there = np.empty(shape, np.uint64), np.empty(shape, np.int64), np.empty(shape), np.empty(shape, np.bool_)
        loops.signals(payloads, self._places, self._linear, bits, raw, values, there)
        if self._floats or self._unsigned64 or self._big:
            self._rewrite(bits, raw, values)
        for those, selector, ids in self._conditions:
            chosen = np.trunc(values[:, selector])
            there[:, those] &= np.logical_or.reduce([(first <= chosen) & (chosen <= last) for first, last in ids])[:, None]
        if self._conditions:
            values[~there] = np.nan
        for column, other in self._branches:
            rows = there[:, other]
            for array in (values, raw, there):
                array[rows, column] = array[rows, other]
        count = len(self.names)
        if count == len(self.layouts):
            return Decoded(values, raw, there)
        return Decoded(values[:, :count], raw[:, :count], there[:, :count])

    def decode(self, payloads: NDArray[np.uint8]) -> NDArray[np.float64]:
        """(N, signals) physical values in the DBC's units, in the order of `names`."""
        return self.decoded(payloads).physical

    def _rewrite(self, bits: NDArray[np.uint64], raw: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        """The columns whose raw value is no int64, or whose product a float does not hold."""
        with np.errstate(over="ignore", invalid="ignore"):  # any bits may be a float's: infinite and NaN are answers
            for column in self._unsigned64:
                values[:, column] = bits[:, column] * self._linear[column, 0] + self._linear[column, 1]
            for column, length in self._floats:
                found = bits[:, column].astype(f"<u{length // 8}").view(f"<f{length // 8}").astype(np.float64)
                values[:, column] = found * self._linear[column, 0] + self._linear[column, 1]
        for column in self._big:
            values[:, column] = self._exactly(column, bits[:, column], raw[:, column])

    def _exactly(self, column: int, bits: NDArray[np.uint64], integers: NDArray[np.int64]) -> list[float]:
        """In Python's numbers, whose integers are not rounded."""
        layout = self.layouts[column]
        raw = integers.tolist() if layout.is_signed else bits.tolist()
        return [float(value * layout.scale + layout.offset) for value in raw]


def _chain(signal: Signal, by_name: dict[str, Signal]) -> list[Signal]:
    """The signal and the selectors above it, as far as their chain goes without a circle."""
    chain = [signal]
    while (above := chain[-1].selected_by) is not None and by_name[above] not in chain:
        chain.append(by_name[above])
    return chain


def _may_exceed_float(layout: SignalLayout) -> bool:
    whole = isinstance(layout.scale, int) and not layout.is_float
    return whole and ((1 << layout.length) * abs(layout.scale) + abs(layout.offset)) > EXACT


def same_layout(one: BatchDecoder, other: BatchDecoder) -> bool:
    """Whether the two decode every payload alike, whatever their signals are called."""
    keys = ("length", "layouts", "_conditions", "_branches")
    return all(getattr(one, key) == getattr(other, key) for key in keys)
