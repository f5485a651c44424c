"""A map without end in tiles of cells, whatever a cell keeps: layers of numbers, read out as log-odds of occupancy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence, Set
from typing import Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.beams import Beams
from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.kernels.dispatch import loops
from echogrid.core.kernels.tiles import overlap
from echogrid.core.map.footprint import Footprint
from echogrid.core.map.tile import SIDE, Layers, Tile, TileKey, tiles_under
from echogrid.core.motion.se2 import SE2

LogOdds = NDArray[np.float32]
OCCUPIED, FREE = 0.5, 0.1  # probabilities from which, and up to which, a cell is to be called so: docs/fusion.md says why
NEWEST_S = 2**32 - 1  # that seen_s can hold: the year 2106


class View(msgspec.Struct, frozen=True, eq=False):
    """Who had which cells in view in one update."""

    stamp_ns: int  # Unix time
    radars: NDArray[np.uint16]  # (H, W) of the patch: bit i is set where radar i of the configuration had the cell in view


class Shelf(Protocol):
    """Where tiles go that the memory has no room for."""

    def load(self, key: TileKey) -> Tile | None:
        """A tile of its own for the caller; None where there is none."""

    def store(self, key: TileKey, tile: Tile) -> None:
        """Takes a tile over in place of what it has of it."""

    def keys(self) -> Set[TileKey]:
        """All that it has."""

    def clear(self, begun_ns: int) -> None:
        """What it has belongs to the map before: from now on it has nothing. `begun_ns`: when the next map begins, Unix time."""


class TiledMap(ABC):
    """Layers in `odom`, held in SIDE x SIDE tiles; cell (i, j) covers y in [i, i + 1) and x in [j, j + 1) cells.

    `tiles` is changed in place, the least recently used first: at most `max_tiles` of them are kept, or as many as one update changes.
    Beyond, that one goes to the shelf, and comes back when an update or a window needs it; where there is no shelf it is forgotten and
    counted in `forgotten`.
    """

    layers: int
    reach = 0.0  # m from the radars up to which `measure` wants detections

    def __init__(self, spec: GridSpec, clamp: float = 3.5, max_tiles: int = 4096) -> None:
        self.spec = spec
        self.clamp = clamp  # log-odds
        self.max_tiles = max_tiles
        self.shelf: Shelf | None = None
        self.forgotten = 0
        self.stamp_ns = 0  # of the newest update whose view was told, Unix time
        self.tiles: dict[TileKey, Tile] = {}
        self.dirty: set[TileKey] = set()  # of `tiles`: those that the shelf has not as they are now

    @abstractmethod
    def takes(self, odom_from_base: SE2) -> bool:
        """Whether an update from here is to be integrated. Asked once for each update."""

    @abstractmethod
    def integrate(self, said: Image, odom_from_base: SE2, view: View | None = None) -> None:
        """Adds what one update says about the cells around the car. `view`: None for answers that come from no radars at no time."""

    def measure(self, beams: Beams, odom_from_base: SE2, view: View) -> None:  # noqa: B027 - most maps have nothing to do here
        """Adds what one update measured, as far as `reach`, after `takes` was asked: at every update, a standing car's too.

        A map that keeps nothing of it has it from `integrate`.
        """

    @abstractmethod
    def read(self, layers: Layers) -> LogOdds:
        """(layers, H, W) -> (H, W) log-odds of occupancy; 0 means not known, and no known cell has exactly 0."""

    @abstractmethod
    def read_tiles(self, keys: NDArray[np.int64], tiles: Sequence[Tile], row: int, column: int, out: LogOdds) -> None:
        """The same of the cells from (row, column) on into `out` (H, W), out of tiles with these keys (T, 2); 0 where there are none."""

    @abstractmethod
    def measured(self, layers: Layers) -> NDArray[np.bool_]:
        """(layers, H, W) -> (H, W): where plain geometry has a word in it; what is known elsewhere is learned only."""

    def clear(self, begun_ns: int) -> None:
        """Starts a new map, at a time of Unix: nothing is known. What the shelf has not yet goes there; `forgotten` goes on counting."""
        if self.shelf is not None:
            for key in self.dirty:
                self.shelf.store(key, self.tiles[key])
            self.shelf.clear(begun_ns)
        self.dirty.clear()
        self.tiles.clear()

    def window(self, row: int, column: int, height: int, width: int) -> LogOdds:
        """Log-odds (height, width) of the cells from (row, column) on; 0 where nothing is known."""
        found = {key: tile for key in tiles_under(row, column, height, width) if (tile := self._used(key)) is not None}
        out = np.empty((height, width), dtype=np.float32)
        self.read_tiles(np.array([*found], np.int64).reshape(-1, 2), [*found.values()], row, column, out)
        return out

    def window_of_layers(self, row: int, column: int, height: int, width: int) -> Layers:
        """(layers, height, width) of the cells from (row, column) on; 0 where nothing was ever seen."""
        out = np.zeros((self.layers, height, width), dtype=np.float32)
        for key, inside, piece in pieces(row, column, height, width):
            tile = self._used(key)
            if tile is not None:
                out[:, *piece] = tile.layers[:, *inside]
        return out

    def window_of_views(self, row: int, column: int, height: int, width: int) -> tuple[NDArray[np.uint32], NDArray[np.uint16]]:
        """`seen_s` and `radars`, each (height, width), of the cells from (row, column) on; see Tile."""
        seen_s, radars = np.zeros((height, width), dtype=np.uint32), np.zeros((height, width), dtype=np.uint16)
        for key, inside, piece in pieces(row, column, height, width):
            tile = self._used(key)
            if tile is not None:
                seen_s[piece], radars[piece] = tile.seen_s[inside], tile.radars[inside]
        return seen_s, radars

    def around(self, pose: SE2, cells: int) -> tuple[int, int, LogOdds]:
        """The window of cells x cells around a pose: row, column of its first cell, log-odds."""
        row = int(np.floor(pose.y / self.spec.cell)) - cells // 2
        column = int(np.floor(pose.x / self.spec.cell)) - cells // 2
        return row, column, self.window(row, column, cells, cells)

    def bounds(self) -> tuple[int, int, int, int]:
        """Row, column, height and width of the rectangle of all tiles, those on the shelf too; all 0 for an empty map."""
        keys = self.tiles.keys() | (self.shelf.keys() if self.shelf is not None else frozenset())
        if not keys:
            return 0, 0, 0, 0
        rows, columns = zip(*keys, strict=True)
        row, column = min(rows) * SIDE, min(columns) * SIDE
        return row, column, (max(rows) + 1) * SIDE - row, (max(columns) + 1) * SIDE - column

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

    def _changing(self, footprint: Footprint, view: View | None) -> tuple[NDArray[np.int64], list[Tile]]:
        """The keys of the tiles under a footprint, as the loops have them (kernels/tiles.py), and the tiles, which are about to be changed.

        What the view tells is noted in them.
        """
        keys = tiles_under(*footprint.lies[:4])
        under, tiles = np.array(keys), self._changed(keys)
        if view is not None:
            self.stamp_ns = view.stamp_ns
            radars, seen_s = [tile.radars for tile in tiles], [tile.seen_s for tile in tiles]
            loops.note_views(view.radars, *footprint.lies, self._now_s(), under, radars, seen_s)
        return under, tiles

    def _now_s(self) -> int:
        """Of the newest update, as `seen_s` has it: recordings may begin at 0, which says never."""
        return min(max(self.stamp_ns // 1_000_000_000, 1), NEWEST_S)

    def _changed(self, keys: Sequence[TileKey]) -> list[Tile]:
        """Tiles that are about to be changed, which stay together until then."""
        room, tiles = max(self.max_tiles, len(keys)), self.tiles
        for key in keys:
            if (tile := tiles.pop(key, None)) is None:
                tile = self._fetched(key, room) or self._keep(key, Tile.empty(self.layers), room)
            tiles[key] = tile
        self.dirty.update(keys)
        return [tiles[key] for key in keys]

    def _used(self, key: TileKey) -> Tile | None:
        """A tile, from the shelf where it is there, as the most recently used one. None where there is none."""
        if (tile := self.tiles.pop(key, None)) is None:
            return self._fetched(key, self.max_tiles)
        self.tiles[key] = tile
        return tile

    def _fetched(self, key: TileKey, room: int) -> Tile | None:
        """From the shelf; None where it is not there. `room` as in `_keep`."""
        tile = None if self.shelf is None else self.shelf.load(key)
        return None if tile is None else self._keep(key, tile, room)

    def _keep(self, key: TileKey, tile: Tile, room: int) -> Tile:
        """Keeps a tile as the most recently used one, of at most `room`."""
        while len(self.tiles) >= room:
            least = next(iter(self.tiles))
            left = self.tiles.pop(least)
            if self.shelf is None:
                self.forgotten += 1
            elif least in self.dirty:
                self.shelf.store(least, left)
            self.dirty.discard(least)
        self.tiles[key] = tile
        return tile


def probability(log_odds: LogOdds) -> LogOdds:
    """p(occupied) of log-odds."""
    p: LogOdds = 0.5 + 0.5 * np.tanh(0.5 * log_odds)  # exp would overflow far from 0
    return p


def pieces(row: int, column: int, height: int, width: int) -> Iterator[tuple[TileKey, tuple[slice, slice], tuple[slice, slice]]]:
    """The tiles under a rectangle: each one's key, the part of the tile, the part of the rectangle."""
    for key in tiles_under(row, column, height, width):
        (i, rows), (j, columns) = overlap(key[0], row, height), overlap(key[1], column, width)
        yield key, (i, j), (rows, columns)
