"""The reference's part in reading lines: none. Every line is read by the line readers of logs/text, which are the oracle of lines.h."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.cells import Bytes, Floats, Integers, Mask


def candump_lines(
    text: Bytes,
    place: Integers,
    stamps: Floats,
    ids: NDArray[np.uint32],
    flags: Bytes,
    dlc: Bytes,
    sizes: Bytes,
    begins: Integers,
    data: Bytes,
    channels: NDArray[np.int32],
    names: Bytes,
) -> None:
    """Reads lines of `text` (bytes,) from byte place[0] on, as far as they are data frames in the form that most have, one after the other.

    Of frame place[1]: s, id, bits as in `can.intake.frames`, bytes by its code and in fact, where they begin in `data`, and its channel:
    which row of `names` (K, 64), filled up with zeros. `place` (4,) then has where the first other line begins, frames, lines and bytes of
    data so far. It stops where there is no room for another. Of columns (N,) and data only what comes is written.
    """


def asc_lines(
    text: Bytes,
    place: Integers,
    stamps: Floats,
    ids: NDArray[np.uint32],
    flags: Bytes,
    dlc: Bytes,
    sizes: Bytes,
    begins: Integers,
    data: Bytes,
    channels: NDArray[np.int32],
    clock: Integers,
    relative: bool,
    origin: float,
) -> None:
    """As `candump_lines`, channels as numbers. Times are `origin` s and what the line says, or says more than the one before if `relative`.

    `clock` (1,): ns, of the last frame's time without the origin.
    """


def trc_lines(
    text: Bytes,
    place: Integers,
    stamps: Floats,
    ids: NDArray[np.uint32],
    flags: Bytes,
    dlc: Bytes,
    sizes: Bytes,
    begins: Integers,
    data: Bytes,
    channels: NDArray[np.int32],
    columns: Bytes,
    start: float,
) -> None:
    """As `candump_lines`, channels as numbers, -1 for none. `columns` (C,): PEAK's letters, D the last one; none: no line is taken.
    `start`: s, of the file's time 0."""


def csv_lines(
    text: Bytes,
    place: Integers,
    stamps: Floats,
    ids: NDArray[np.uint32],
    flags: Bytes,
    dlc: Bytes,
    sizes: Bytes,
    begins: Integers,
    data: Bytes,
    channels: NDArray[np.int32],
) -> None:
    """As `candump_lines`, of python-can's CSV; all channels -1."""


def blf_objects(
    data: Bytes, place: Integers, places: Integers, kinds: Integers, wanted: Mask, base: int, most: int, most_wanted: int
) -> None:
    """Steps from object to object of a BLF in `data` (bytes,), from byte place[0] on, as far as one follows the other.

    Where object place[1] begins goes into `places` and what it is into `kinds` (both (N,), with room enough); `place` (2,) then has where
    the last one ends, and how many there are. An object has `base` bytes to begin with and up to `most`, `most_wanted` if it is `wanted`
    (kinds,).
    """
