"""The reference's loops over payloads: signals out of them, and what these mean."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.cells import Bytes, Floats, Integers, Mask

GREATEST = 1e9  # SI units; a larger value is not a measurement, but a float read from garbage


@np.errstate(over="ignore", invalid="ignore")  # of values that are garbage
def signals(
    payloads: Bytes, places: Integers, linear: Floats, bits: NDArray[np.uint64], raw: Integers, physical: Floats, there: Mask
) -> None:
    """Signals (N, C) out of payloads (N, length): their `bits`, the integer that these are, and that times a scale plus an offset,
    `linear` (C, 2). `places` (C, 5): byte of the lowest bit, 1 where higher ones follow in the bytes behind it and -1 where in those
    before it, shift of the lowest bit in its byte, length in bits, 1 for signed ones. Bytes beyond a payload are 0. All are `there`."""
    (first, step, shift, length, is_signed), size, margin = places.T, payloads.shape[1], 9
    rows = np.zeros((len(payloads), 2 * (size + margin)), dtype=np.uint8)  # the payload forwards and backwards: each signal reads upwards
    rows[:, :size] = payloads
    rows[:, size + margin : -margin] = payloads[:, ::-1]
    at = np.where(step > 0, first, 2 * size + margin - 1 - first)
    words = np.ndarray((len(rows), rows.shape[1] - 7), "<u8", rows, strides=(rows.shape[1], 1))  # the word that begins at each byte
    bits[:] = words[:, at] >> shift.astype(np.uint64)
    for column in np.flatnonzero(shift + length > 64):
        bits[:, column] |= rows[:, at[column] + 8].astype(np.uint64) << np.uint64(64 - shift[column])
    bits &= np.uint64(2**64 - 1) >> (64 - length).astype(np.uint64)
    sign = np.where(is_signed > 0, np.uint64(1) << (length - 1).astype(np.uint64), np.uint64(0))
    raw[:] = ((bits ^ sign) - sign).view(np.int64)
    physical[:] = raw * linear[:, 0] + linear[:, 1]
    there[:] = True


@np.errstate(over="ignore", invalid="ignore")
def quantities(
    physical: Floats,
    raw: Integers,
    there: Mask,
    each: int,
    plan: Integers,
    units: Floats,
    flags: Integers,
    numbers: Integers,
    everywhere: int,
    greatest: float,
    out: Floats,
) -> None:
    """Quantities (Q, N * each), frame by frame, out of N frames' signals (N, C): `each` of every signal in a row.

    `plan` (Q, 3): which signal, which flag says that it is valid, and which that it is negative; -1 for none. `units` (Q, 2): factor,
    offset. `flags` (F, 4): which signal, 1 if it is to be one of numbers[begin:end] or 0 if none of them, begin, end; a signal that is not
    `there` is no flag. `everywhere`: the flag that all need, or -1. NaN where not valid, or not less than `greatest`.
    """

    def by_signal(columns: NDArray[Any]) -> NDArray[Any]:
        rows, width = columns.shape
        return columns.reshape(rows, width // each, each).transpose(1, 0, 2).reshape(width // each, rows * each)

    values, integers, known = by_signal(physical), by_signal(raw), by_signal(there)
    holds = [
        ((integers[signal, :, None] == numbers[begin:end]).any(axis=1) == bool(one_of)) & known[signal]
        for signal, one_of, begin, end in flags.tolist()
    ]
    for value, (signal, valid, negative), (factor, offset) in zip(out, plan.tolist(), units, strict=True):
        value[:] = values[signal] * factor + offset
        if negative >= 0:
            value[:] = np.where(holds[negative], -value, value)
        for flag in (valid, everywhere):
            if flag >= 0:
                value[~holds[flag]] = np.nan
        value[~(np.abs(value) < greatest)] = np.nan


class Head(IntEnum):
    """How a plan begins: bytes of a payload that are read, quantities of a kind in it, the flag that all need or -1, how many signals,
    kinds of quantities, flags and numbers follow, and where its scales begin."""

    BYTES = 0
    EACH = 1
    EVERYWHERE = 2
    SIGNALS = 3
    QUANTITIES = 4
    FLAGS = 5
    NUMBERS = 6
    SCALES = 7


def evaluate(plans: Integers, scales: Floats, at: int, payloads: Bytes, greatest: float, out: Floats) -> None:
    """Quantities (columns, N * each), frame by frame, out of payloads (N, length or more), as the plan says that begins at `at`.

    Behind its Head: (signals, 5) places, (quantities, 4) plan with the column of `out` as the fourth, (flags, 4) and the numbers. Of
    `scales`: (signals, 2) linear and (quantities, 2) units. All as in `signals` and `quantities`. What no quantity goes into stays.
    """
    head = plans[at : at + len(Head)].tolist()
    rows = [(head[Head.SIGNALS], 5), (head[Head.QUANTITIES], 4), (head[Head.FLAGS], 4), (head[Head.NUMBERS], 1)]
    ends = np.cumsum([len(Head), *(count * width for count, width in rows)]) + at
    places, plan, flags, numbers = (plans[a:b].reshape(shape) for a, b, shape in zip(ends, ends[1:], rows, strict=False))
    first, last = head[Head.SCALES], head[Head.SCALES] + 2 * head[Head.SIGNALS]
    linear, units = scales[first:last].reshape(-1, 2), scales[last : last + 2 * len(plan)].reshape(-1, 2)
    shape = (len(payloads), len(places))
    bits, raw, physical, there = np.empty(shape, np.uint64), np.empty(shape, np.int64), np.empty(shape), np.empty(shape, np.bool_)
    signals(payloads[:, : head[Head.BYTES]], places, linear, bits, raw, physical, there)
    found = np.empty((len(plan), len(payloads) * head[Head.EACH]))
    each, everywhere = head[Head.EACH], head[Head.EVERYWHERE]
    quantities(physical, raw, there, each, plan[:, :3], units, flags, numbers[:, 0], everywhere, greatest, found)
    out[plan[:, 3]] = found
