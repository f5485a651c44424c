"""A map without end in tiles of cells, whatever a cell keeps: layers of numbers, read out as log-odds of occupancy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from echogrid.core.raster import GridSpec, Image
from echogrid.core.se2 import SE2

TILE = 128  # cells along a tile's side
LogOdds = NDArray[np.float32]
Layers = NDArray[np.float32]  # (L, H, W)
Tile = tuple[int, int]  # row and column of tiles


class TiledMap(ABC):
    """Layers in `odom`, held in TILE x TILE tiles; cell (i, j) covers y in [i, i + 1) and x in [j, j + 1) cells.

    `tiles` is changed in place by `integrate`. At most `max_tiles` are kept; beyond, the one farthest from the car is forgotten and
    counted in `forgotten`.
    """

    layers: int

    def __init__(self, spec: GridSpec, max_tiles: int) -> None:
        self.spec = spec
        self.max_tiles = max_tiles
        self.forgotten = 0
        self.tiles: dict[Tile, Layers] = {}

    @abstractmethod
    def takes(self, odom_from_base: SE2) -> bool:
        """Whether an update from here is to be integrated. Asked once for each update."""

    @abstractmethod
    def integrate(self, said: Image, odom_from_base: SE2) -> None:
        """Adds what one update says about the cells around the car."""

    @abstractmethod
    def read(self, layers: Layers) -> LogOdds:
        """(layers, H, W) -> (H, W) log-odds of occupancy; 0 means not known, and no known cell has exactly 0."""

    def clear(self) -> None:
        """Begins anew: nothing is known. `forgotten` goes on counting."""
        self.tiles.clear()

    def window(self, row: int, column: int, height: int, width: int) -> LogOdds:
        """Log-odds (height, width) of the cells from (row, column) on; 0 where nothing is known."""
        return self.read(self.window_of_layers(row, column, height, width))

    def window_of_layers(self, row: int, column: int, height: int, width: int) -> Layers:
        """(layers, height, width) of the cells from (row, column) on; 0 where nothing was ever seen."""
        out = np.zeros((self.layers, height, width), dtype=np.float32)
        for tile, inside, piece in self._pieces(row, column, height, width, create=False):
            out[:, *piece] = tile[:, *inside]
        return out

    def around(self, pose: SE2, cells: int) -> tuple[int, int, LogOdds]:
        """The window of cells x cells around a pose: row, column of its first cell, log-odds."""
        row = int(np.floor(pose.y / self.spec.cell)) - cells // 2
        column = int(np.floor(pose.x / self.spec.cell)) - cells // 2
        return row, column, self.window(row, column, cells, cells)

    def bounds(self) -> tuple[int, int, int, int]:
        """Row, column, height and width of the rectangle of all tiles; all 0 for an empty map."""
        if not self.tiles:
            return 0, 0, 0, 0
        rows, columns = zip(*self.tiles, strict=True)
        row, column = min(rows) * TILE, min(columns) * TILE
        return row, column, (max(rows) + 1) * TILE - row, (max(columns) + 1) * TILE - column

    def whole(self) -> tuple[int, int, LogOdds]:
        """All that is known, without empty borders: row, column of the first cell, log-odds. (0, 0, shape (0, 0)) for an empty map."""
        first_row, first_column, height, width = self.bounds()
        everything = self.window(first_row, first_column, height, width)
        known_rows = np.flatnonzero(everything.any(axis=1))
        known_columns = np.flatnonzero(everything.any(axis=0))
        if not len(known_rows):
            return 0, 0, np.zeros((0, 0), dtype=np.float32)
        top, left = int(known_rows[0]), int(known_columns[0])
        cut = everything[top : known_rows[-1] + 1, left : known_columns[-1] + 1]
        return first_row + top, first_column + left, np.ascontiguousarray(cut)

    def _pieces(
        self, row: int, column: int, height: int, width: int, *, create: bool
    ) -> Iterator[tuple[Layers, tuple[slice, slice], tuple[slice, slice]]]:
        """The tiles under a rectangle: each tile's layers, the part of the tile, the part of the rectangle."""
        for tile_row in range(row // TILE, (row + height - 1) // TILE + 1):
            for tile_column in range(column // TILE, (column + width - 1) // TILE + 1):
                tile = self.tiles.get((tile_row, tile_column))
                if tile is None:
                    if not create:
                        continue
                    tile = self.tiles[tile_row, tile_column] = np.zeros((self.layers, TILE, TILE), dtype=np.float32)
                rows = _overlap(tile_row, row, height)
                columns = _overlap(tile_column, column, width)
                yield tile, (rows[0], columns[0]), (rows[1], columns[1])

    def _forget(self, odom_from_base: SE2) -> None:
        while len(self.tiles) > self.max_tiles:
            side = TILE * self.spec.cell
            here = (odom_from_base.y / side - 0.5, odom_from_base.x / side - 0.5)
            farthest = max(self.tiles, key=lambda tile: np.hypot(tile[0] - here[0], tile[1] - here[1]))
            del self.tiles[farthest]
            self.forgotten += 1


def resample(planes: Layers, odom_from_base: SE2, spec: GridSpec) -> tuple[int, int, Layers]:
    """Planes (P, H, W) around the car on the map's cells: first row, first column, (P, height, width).

    Each map cell reads the patch at its own centre, bilinear, so that a turn neither doubles nor loses evidence; outside is 0.
    """
    cell, half = spec.cell, spec.half
    reach = (half + cell / 2) * (abs(np.cos(odom_from_base.yaw)) + abs(np.sin(odom_from_base.yaw)))
    column = int(np.floor((odom_from_base.x - reach) / cell))
    row = int(np.floor((odom_from_base.y - reach) / cell))
    size = int(np.ceil(2 * reach / cell)) + 1
    c, s = np.cos(odom_from_base.yaw), np.sin(odom_from_base.yaw)
    # From the car, in cells: small enough for float32, which halves the time.
    dx = (((column + np.arange(size) + 0.5) * cell - odom_from_base.x) / cell).astype(np.float32)
    dy = (((row + np.arange(size) + 0.5) * cell - odom_from_base.y) / cell).astype(np.float32)[:, None]
    # Patch coordinates in cells, shifted by the half cell to the centres and by the border of one zero cell.
    c, s, shift = np.float32(c), np.float32(s), np.float32(half / cell + 0.5)
    u = c * dx + s * dy + shift
    v = c * dy - s * dx + shift
    padded = np.pad(planes, ((0, 0), (1, 1), (1, 1)))
    limit = spec.cells  # padded has cells + 2 entries: 0 … cells + 1
    outside = (u < 0) | (v < 0) | (u >= limit + 1) | (v >= limit + 1)
    u0, v0 = np.floor(u), np.floor(v)
    fu, fv = u - u0, v - v0
    flat = np.where(outside, 0, v0 * (limit + 2) + u0).astype(np.intp)
    out = np.empty((len(planes), size, size), dtype=np.float32)
    for plane, values in zip(out, padded.reshape(len(planes), -1), strict=True):
        below = values[flat] * (1 - fu) + values[flat + 1] * fu
        above = values[flat + limit + 2] * (1 - fu) + values[flat + limit + 3] * fu
        plane[:] = np.where(outside, np.float32(0), below * (1 - fv) + above * fv)
    return row, column, out


def probability(log_odds: LogOdds) -> LogOdds:
    """p(occupied) of log-odds."""
    p: LogOdds = 0.5 + 0.5 * np.tanh(0.5 * log_odds)  # exp would overflow far from 0
    return p


def _overlap(tile: int, first: int, length: int) -> tuple[slice, slice]:
    """Along one axis: the slice of the tile and the slice of the rectangle [first, first + length) that cover each other."""
    start, stop = max(tile * TILE, first), min((tile + 1) * TILE, first + length)
    return slice(start - tile * TILE, stop - tile * TILE), slice(start - first, stop - first)
