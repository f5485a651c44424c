"""Cells, by flat index: of patches, of windows of the map, of tiles; and what is counted in them. What the reference is made of."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Integers = NDArray[np.int64]
Places = NDArray[np.int32]
Bytes = NDArray[np.uint8]
Bits = NDArray[np.uint16]
Mask = NDArray[np.bool_]
Whole = TypeVar("Whole", bound=np.integer[Any])

SIDE = 128  # cells along a tile's side
OWN, PASSED, HIT = 1, 2, 4  # bits of what a look has marked a cell with


def once(values: NDArray[Whole]) -> NDArray[Whole]:
    """Those of (N,) whole numbers that differ, in order. Sorts; np.unique fills a hash table since numpy 2.3: 2 to 3 times as long."""
    ordered = np.sort(values)
    return ordered[np.r_[True, ordered[1:] != ordered[:-1]]] if len(ordered) else ordered


def patch_cells(points: NDArray[np.floating], half: float, cell: float, side: int) -> Integers:
    """Flat cell (…,) of points (…, 2) in a patch of side x side cells around the middle; -1 outside."""
    place = np.floor((points + half) / cell).astype(np.int64)
    column, row = place[..., 0], place[..., 1]
    return np.where((column >= 0) & (column < side) & (row >= 0) & (row < side), row * side + column, -1)


def window_cells(points: Floats, row: int, column: int, size: int, cell: float) -> Integers:
    """Flat cell (…,) of points (…, 2) in odom in a window of size x size map cells from (row, column) on; -1 outside."""
    place = np.floor(points / cell).astype(np.int64)
    j, i = place[..., 0] - column, place[..., 1] - row
    return np.where((i >= 0) & (i < size) & (j >= 0) & (j < size), i * size + j, -1)


def places(
    cells: int, row: int, column: int, height: int, width: int, cell: float, x: float, y: float, cos: float, sin: float, shift: float
) -> tuple[NDArray[np.intp], Singles, Singles, Mask, int]:
    """For map cells (height, width), as they lie in `tiles`: the place in the patch with its border of the cell to the lower left, how far
    on from its centre along x and y, and which lie outside; and how long that patch's rows are."""
    dx, rows = (
        (((np.arange(0.5, count) + first) * cell - at) / cell).astype(np.float32)
        for count, first, at in ((width, column, x), (height, row, y))
    )
    c, s, offset, dy = np.float32(cos), np.float32(sin), np.float32(shift), rows[:, None]
    u = c * dx + s * dy + offset
    v = c * dy - s * dx + offset
    outside = (u < 0) | (v < 0) | (u >= cells + 1) | (v >= cells + 1)
    u0, v0 = np.floor(u), np.floor(v)
    return np.where(outside, 0, v0 * (cells + 2) + u0).astype(np.intp), u - u0, v - v0, outside, cells + 2


def count(cells: Integers, table: Bytes, shape: tuple[int, ...]) -> Bytes:
    """How many of the flat cells (N,) are each cell, as the table has it; -1 is none."""
    counts = np.bincount(cells[cells >= 0], minlength=int(np.prod(shape)))
    return table[np.minimum(counts, 255)].reshape(shape)


def largest(cells: Integers, values: Bytes, shape: tuple[int, ...]) -> Bytes:
    """The largest value in each cell, 0 where there is none."""
    plane = np.zeros(shape, dtype=np.uint8)
    order = np.argsort(values, kind="stable")
    order = order[cells[order] >= 0]
    plane.reshape(-1)[cells[order]] = values[order]  # of several, numpy keeps the last
    return plane


def byte_of_rcs(rcs: Floats) -> Bytes:
    """1 at -32 dBsm and below, 255 at 31 and above, 0 where none is reported (NaN)."""
    known = np.where(np.isnan(rcs), -128.0, rcs)
    return np.where(np.isnan(rcs), 0, np.clip(np.rint(128 + 4 * known), 1, 255)).astype(np.uint8)


def spread(blocks: Bytes, along: int, out: Bytes) -> None:
    """(H, W) -> (along H, along W), every value along x along times."""
    out[:] = np.repeat(np.repeat(blocks, along, axis=0), along, axis=1)


def by_tile(cells: Integers, row: int, column: int, size: int, begins: Integers) -> tuple[Integers, Places]:
    """Flat cells (K,) of a window of map cells tile by tile: their order, and in that order the flat cells in their tiles. `begins`
    (T + 1,) is filled with where each tile's begin."""
    i, j = cells // size + row, cells % size + column
    wide = (column + size - 1) // SIDE - column // SIDE + 1
    tile = (i // SIDE - row // SIDE) * wide + j // SIDE - column // SIDE
    order = np.argsort(tile, kind="stable")
    begins[:] = np.searchsorted(tile[order], np.arange(len(begins)))
    return order, ((i % SIDE) * SIDE + j % SIDE)[order].astype(np.int32)
