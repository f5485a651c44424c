"""The reference's way to tell whose frames are, when they came, and what of them does not depend on others."""

from __future__ import annotations

from enum import IntEnum, IntFlag

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.can_frames import ERROR, EXTENDED, REMOTE
from echogrid.core.kernels.cells import Bytes, Floats, Integers, Mask
from echogrid.core.kernels.frames import evaluate, signals

LATEST = 4.6e9  # s since 1970: a stamp beyond is none
BUS_BIT, EXTENDED_BIT = 33, 32  # of a key, above those of the id


class Sort(IntFlag):
    """Of a frame: traffic, which an error frame is not; nobody reads it; without data, though somebody reads it; somebody reads it who is
    no radar."""

    COUNTS = 1
    UNKNOWN = 2
    REMOTE = 4
    OTHER = 8


class Check(IntEnum):
    """Columns of a frame's own checksum: where its bytes' tables begin (-1: it has none), how many bytes, and where it is (5)."""

    TABLE = 0
    BYTES = 1
    PLACE = 2


class Says(IntEnum):
    """Columns of what a motion frame says: its bytes (-1: it is none), plans of the wheels and of the yaw rate (-1: none), and where
    its counter (5) and the direction of travel (5) are, all 0 for none."""

    BYTES = 0
    WHEELS = 1
    YAW = 2
    COUNTER = 3
    DIRECTION = 8


def identify(
    stamps: Floats,
    ids: NDArray[np.uint32],
    flags: Bytes,
    sizes: Bytes,
    begins: Integers,
    data: Bytes,
    buses: Integers,
    keys: Integers,
    rows: Integers,
    known: Integers,
    checks: Integers,
    tables: NDArray[np.uint64],
    says: Integers,
    plans: Integers,
    scales: Floats,
    greatest: float,
    received: Integers,
    roles: Integers,
    sorts: Bytes,
    wrong: Mask,
    values: Floats,
    counted: Integers,
) -> None:
    """What frames (N,) are, with the time, id, flags, bytes and bus of each: `rows` of the one of `keys`, in order, that is theirs.

    `known` (K, 5) as in `assemble`, `checks` (K, 7): Check, `says` (K, 13): Says. `tables` (T, 256): what a byte adds to the checksum at
    each place. Written: when they were `received`, ns, to the microsecond; `roles`, rows of `known`, -1 where nobody reads them or they
    have no data; their Sort; where a checksum is `wrong`, or what says something too short; the speeds of the wheels and the yaw rate
    in `values` (N, 3), NaN where they are not said, and counter and direction in `counted` (N, 2).
    """
    received[:] = nanoseconds(np.where(np.abs(stamps) < LATEST, stamps, 0.0))
    found = buses << BUS_BIT | (flags & EXTENDED).astype(np.int64) << EXTENDED_BIT | ids
    places = np.minimum(np.searchsorted(keys, found), len(keys) - 1)
    row = np.where(keys[places] == found, rows[places], -1) if len(keys) else np.full(len(found), -1)
    counts, remote = flags & ERROR == 0, flags & REMOTE != 0
    roles[:] = np.where(counts & ~remote, row, -1)
    other = (roles >= 0) & (known[roles, 0] < 0) if len(known) else np.zeros(len(roles), np.bool_)
    sorts[:] = counts * (Sort.COUNTS | (row < 0) * Sort.UNKNOWN | ((row >= 0) & remote) * Sort.REMOTE) | other * Sort.OTHER
    wrong[:], values[:], counted[:] = False, np.nan, 0
    for role in np.flatnonzero((checks[:, Check.TABLE] >= 0) | (says[:, Says.BYTES] >= 0)).tolist():
        ours = np.flatnonzero(roles == role)
        first, length, *place = checks[role].tolist()
        if first >= 0:
            some = ours[sizes[ours] >= length]
            payloads = data[begins[some, None] + np.arange(length)]
            sums = np.bitwise_xor.reduce(tables[first + np.arange(length), payloads], axis=1, initial=0)
            wrong[some] = sums != _integers(payloads, place).view(np.uint64)
        length, wheels, yaw, *fields = says[role].tolist()
        if length >= 0:
            wrong[ours] |= sizes[ours] < length
            some = ours[sizes[ours] >= length]
            payloads = data[begins[some, None] + np.arange(length)]
            for plan, columns in ((wheels, slice(0, 2)), (yaw, slice(2, 3))):
                if plan >= 0:
                    out = np.full((columns.stop - columns.start, len(some)), np.nan)
                    evaluate(plans, scales, plan, payloads, greatest, out)
                    values[some, columns] = out.T
            for column, place in enumerate((fields[:5], fields[5:])):
                if place[3]:
                    counted[some, column] = _integers(payloads, place)


def _integers(payloads: Bytes, place: list[int]) -> Integers:
    """(N,) what is at a place of payloads (N, length)."""
    raw, other = np.empty((len(payloads), 1), np.int64), np.empty((len(payloads), 1))
    there = np.empty_like(other, np.bool_)
    signals(payloads, np.array([place], np.int64), np.zeros((1, 2)), np.empty_like(other, np.uint64), raw, other, there)
    return raw[:, 0]


def nanoseconds(stamps: Floats) -> Integers:
    """Seconds (N,) as ns, to the microsecond.

    A float of seconds since 1970 holds microseconds, not nanoseconds. Of its fraction, 22 bits, the product is exact, so that it is rounded
    as in a text log; rounding the whole float would give another microsecond for one frame in eight.
    """
    fraction, seconds = np.modf(stamps)
    found: Integers = (seconds.astype(np.int64) * 1_000_000 + np.rint(fraction * 1e6).astype(np.int64)) * 1000
    return found
