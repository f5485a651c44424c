"""Checksums of frames of one length as tables: what each byte adds, at its place, whatever the algorithm is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from echogrid.can.dbc import Checksum
from echogrid.can.decode import place_of

WRONG = 1 << 40  # set in the sum where no checksum is right: none has so many bits


def table_of(checksum: Checksum, length: int) -> NDArray[np.uint64]:
    """(length, 256): a frame's checksum is that of all its bytes' rows taken together by exclusive or.

    A cyclic redundancy check of frames of one length is linear in their bits but for what it is of zeros, which the first row has. Not so
    an end-to-end protection's data id, which the byte behind the checksum chooses: that one is asked for all its values, and the others
    beside one of them that may be right.
    """
    first, behind = checksum.place

    def sum_of(places: dict[int, int]) -> int:
        payload = bytearray(length)
        for place, byte in places.items():
            payload[place] = byte
        found = checksum.compute(checksum.others(bytes(payload)))
        return found if found >= 0 else WRONG

    table = np.zeros((length, 256), np.uint64)
    chosen: dict[int, int] = {}
    if behind < length:
        sums = [sum_of({behind: byte}) for byte in range(256)]
        chosen[behind] = next(byte for byte, found in enumerate(sums) if found != WRONG)
        table[behind] = sums
    none = sum_of(chosen)
    if behind >= length:
        table[first] = none  # which is as good a place, since it adds nothing else
    for place in [place for place in range(length) if not first <= place <= behind]:
        for bit in range(8):
            table[place, 1 << bit : 2 << bit] = table[place, : 1 << bit] ^ np.uint64(sum_of({**chosen, place: 1 << bit}) ^ none)
    return table


class Sums:
    """Remembers the tables of all checksums, one behind the other; one that several ids share is there once."""

    def __init__(self) -> None:
        self._tables = [np.zeros((0, 256), np.uint64)]
        self._begins: dict[tuple[Checksum, int], int] = {}

    def add(self, checksum: Checksum | None, length: int) -> tuple[int, ...]:
        """As `identify` has it, of frames of that length."""
        if checksum is None:
            return (-1, 0, *place_of(None))
        if (checksum, length) not in self._begins:
            self._begins[checksum, length] = sum(map(len, self._tables))
            self._tables.append(table_of(checksum, length))
        return (self._begins[checksum, length], length, *place_of(checksum.layout))

    def tables(self) -> NDArray[np.uint64]:
        """All of them."""
        return np.concatenate(self._tables)
