"""Maps of several drives into one, a tile at a time.

A cell of the merged map keeps the sum of what the same place keeps in every map, in double precision and in the maps' order, so that it is
the same bits wherever it is computed. Both fusion rules keep sums: of log-odds (Eq. 1 of the paper), or of looks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map.look_map import MOST_LOOKS, MOST_MEASURED
from echogrid.core.map.tile import SIDE, Tile, TileKey
from echogrid.core.map.tiled_map import pieces
from echogrid.core.motion.se2 import SE2

Fetch = Callable[[TileKey], Tile | None]  # a map's tiles

WHOLE = 1e-6  # cells; an offset nearer to whole cells than that is whole


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a map lies in the merged one, in cells: p_merged = R p + (x, y), R the turn with this cosine and sine.

    Made once and handed on, so that no other machine's cosine comes into it.
    """

    cosine: float
    sine: float
    x: float
    y: float

    @property
    def whole_cells(self) -> tuple[int, int] | None:
        """Rows and columns of a move that takes cells to cells; None where cells come to lie between cells."""
        column, row = round(self.x), round(self.y)
        if self.sine == 0 and self.cosine == 1 and abs(self.x - column) < WHOLE and abs(self.y - row) < WHOLE:
            return row, column
        return None


def placement(merged_from_map: SE2, cell: float) -> Placement:
    """`cell`: m."""
    return Placement(math.cos(merged_from_map.yaw), math.sin(merged_from_map.yaw), merged_from_map.x / cell, merged_from_map.y / cell)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """A map to be merged: its tiles, where it lies, and for each bit of its tiles' `radars` the bit in the merged map."""

    fetch: Fetch
    placement: Placement
    bits: tuple[int, ...]


def touched(tile: TileKey, at: Placement) -> Iterable[TileKey]:
    """The tiles of the merged map that cells of a map's tile can reach."""
    whole = at.whole_cells
    if whole is not None:
        rows, columns = ((SIDE * tile[axis] + whole[axis], SIDE * (tile[axis] + 1) + whole[axis]) for axis in (0, 1))
    else:
        # The square with the half cell around it that bilinear reading reaches into, turned.
        half = SIDE / 2 + 0.5
        middle_x, middle_y = SIDE * (tile[1] + 0.5), SIDE * (tile[0] + 0.5)
        x, y = at.cosine * middle_x - at.sine * middle_y + at.x, at.sine * middle_x + at.cosine * middle_y + at.y
        reach = half * (abs(at.cosine) + abs(at.sine)) + 0.5
        rows, columns = ((math.floor(middle - reach), math.ceil(middle + reach)) for middle in (y, x))
    for row in range(rows[0] // SIDE, (rows[1] - 1) // SIDE + 1):
        for column in range(columns[0] // SIDE, (columns[1] - 1) // SIDE + 1):
            yield row, column


def merge_tile(key: TileKey, sources: Iterable[Source], kind: str, clamp: float) -> Tile | None:
    """The merged map's tile; None where no map knows anything of it.

    A cell that one map alone has something to say of stays as that map has it. Where several have, what `integrate` holds to is held to
    once, after the sum: log-odds within +-clamp, or no more than MOST_LOOKS and MOST_MEASURED looks.
    """
    total: NDArray[np.float64] | None = None
    seen_s = np.zeros((SIDE, SIDE), dtype=np.uint32)
    radars = np.zeros((SIDE, SIDE), dtype=np.uint16)
    voices = np.zeros((SIDE, SIDE), dtype=np.intp)
    judged = np.zeros((SIDE, SIDE), dtype=bool)
    for source in sources:
        found = _lay(key, source)
        if found is None:
            continue
        layers, their_seen_s, their_radars = found
        total = layers if total is None else total + layers
        voices += layers.any(axis=0)
        judged |= layers[0] != 0
        np.maximum(seen_s, their_seen_s, out=seen_s)
        radars |= _renamed(their_radars, source.bits)
    if total is None:
        return None
    several = voices > 1
    if kind == "looks":
        total[:2] *= np.where(several, np.minimum(1.0, MOST_LOOKS / np.maximum(total[1], 1.0)), 1.0)
        total[2:] *= np.where(several, np.minimum(1.0, MOST_MEASURED / np.maximum(total[2] + total[4], 1.0)), 1.0)
        return Tile(total.astype(np.float32), seen_s, radars)
    total[0] = np.where(several, np.clip(total[0], -clamp, clamp), total[0])
    merged = total.astype(np.float32)
    merged[0][judged & (merged[0] == 0)] = np.finfo(np.float32).tiny  # evidence that cancels is still seen
    return Tile(merged, seen_s, radars)


Laid = tuple[NDArray[np.float64], NDArray[np.uint32], NDArray[np.uint16]]


def _lay(key: TileKey, source: Source) -> Laid | None:
    """A map's layers, seen_s and radars on the cells of a tile of the merged map; None where it knows nothing of it."""
    row, column = SIDE * key[0], SIDE * key[1]
    at = source.placement
    whole = at.whole_cells
    if whole is not None:
        return _cut(source.fetch, row - whole[0], column - whole[1], SIDE, SIDE)
    # Each cell reads the map at its own centre, bilinear, as a map reads a patch.
    dx = column + np.arange(SIDE) + 0.5 - at.x
    dy = (row + np.arange(SIDE) + 0.5 - at.y)[:, None]
    u, v = at.cosine * dx + at.sine * dy - 0.5, at.cosine * dy - at.sine * dx - 0.5
    left, low = np.floor(u), np.floor(v)
    fu, fv = u - left, v - low
    first_row, first_column = int(low.min()), int(left.min())
    width = int(left.max()) + 2 - first_column
    found = _cut(source.fetch, first_row, first_column, int(low.max()) + 2 - first_row, width)
    if found is None:
        return None
    layers, seen_s, radars = (array.reshape(*array.shape[:-2], -1) for array in found)
    corner = ((low - first_row) * width + (left - first_column)).astype(np.intp)
    laid = np.zeros((len(layers), SIDE, SIDE))
    newest, by = np.zeros((SIDE, SIDE), dtype=np.uint32), np.zeros((SIDE, SIDE), dtype=np.uint16)
    for step, share in ((0, (1 - fv) * (1 - fu)), (1, (1 - fv) * fu), (width, fv * (1 - fu)), (width + 1, fv * fu)):
        laid += layers.take(corner + step, axis=-1) * share
        reached = share > 0
        np.maximum(newest, seen_s.take(corner + step) * reached, out=newest)
        by |= radars.take(corner + step) * reached
    return (laid, newest, by) if laid.any() or newest.any() else None


def _cut(fetch: Fetch, row: int, column: int, height: int, width: int) -> Laid | None:
    """A rectangle of a map's cells; None where none of its tiles is there."""
    found: Laid | None = None
    for key, inside, piece in pieces(row, column, height, width):
        tile = fetch(key)
        if tile is None:
            continue
        if found is None:
            shape = (height, width)
            found = np.zeros((len(tile.layers), *shape)), np.zeros(shape, dtype=np.uint32), np.zeros(shape, dtype=np.uint16)
        layers, seen_s, radars = found
        layers[:, *piece] = tile.layers[:, *inside]
        seen_s[piece], radars[piece] = tile.seen_s[inside], tile.radars[inside]
    return found


def _renamed(radars: NDArray[np.uint16], bits: tuple[int, ...]) -> NDArray[np.uint16]:
    renamed = np.zeros_like(radars)
    for old, new in enumerate(bits):
        renamed |= (radars >> old & 1) << new
    return renamed
