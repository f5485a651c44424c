"""One map of a store, read a tile at a time: what it holds, as a small picture, and as planes in bands of rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map.map_delta import NOTHING, Rectangle, changed
from echogrid.core.map.tile import SIDE, Tile, TileKey
from echogrid.core.map.tiled_map import LogOdds, pieces
from echogrid.errors import EchogridError
from echogrid.maps.dense_map import MOST_CELLS
from echogrid.maps.picture import shrink
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore

T = TypeVar("T", bound=np.generic)
OnProgress = Callable[[float], None]  # the share that is done


def part(on_progress: OnProgress | None, n: int, of: int) -> OnProgress | None:
    """For the n-th of several equal steps."""
    return None if on_progress is None else lambda share: on_progress((n + share) / of)


@dataclass(slots=True)
class Extent:
    """What an epoch's cells say in all."""

    known: Rectangle = NOTHING  # the smallest that holds all known cells
    known_cells: int = 0
    measured_cells: int = 0
    oldest_s: int | None = None  # Unix time; None where no cell says when it was in view
    newest_s: int | None = None


class StoredEpoch:
    """Remembers which tiles there are. While another process writes the file, each tile is as it was when it was read."""

    def __init__(self, store: TileStore, number: int | None) -> None:
        """`number`: None is the newest. Raises EchogridError if there is none with that number."""
        epochs = {epoch.id: epoch for epoch in store.epochs()}
        if number is None and not epochs:
            raise EchogridError(f"{store.path}: holds no map: it has no epoch")
        chosen = max(epochs) if number is None else number
        if chosen not in epochs:
            raise EchogridError(f"{store.path}: epoch {chosen} is not there, found {', '.join(map(str, epochs)) or 'none'}")
        self.store = store
        self.number = chosen
        self.description = epochs[chosen].description
        self.bytes = epochs[chosen].bytes  # of its tiles on disk
        self.keys = store.tiles(chosen)
        self._rule = stored_map(store, chosen)

    def tile(self, key: TileKey) -> Tile | None:
        """Raises EchogridError where it is damaged."""
        return self.store.read(self.number, key)

    def log_odds(self, tile: Tile) -> LogOdds:
        """(SIDE, SIDE); 0 where nothing is known."""
        return self._rule.read(tile.layers)

    def measured(self, tile: Tile) -> NDArray[np.bool_]:
        """(SIDE, SIDE): known from plain geometry; what is known elsewhere is learned only."""
        measured: NDArray[np.bool_] = self._rule.measured(tile.layers) & (self.log_odds(tile) != 0)
        return measured

    def tiles(self, on_progress: OnProgress | None = None) -> Iterator[tuple[TileKey, Tile]]:
        """All of them, one at a time."""
        for number, key in enumerate(self.keys):
            tile = self.tile(key)
            if tile is not None:  # it may have been forgotten meanwhile
                yield key, tile
            if on_progress is not None:
                on_progress((number + 1) / len(self.keys))

    def extent(self, on_progress: OnProgress | None = None) -> Extent:
        """Reads every tile."""
        extent = Extent()
        for (row, column), tile in self.tiles(on_progress):
            known = self.log_odds(tile) != 0
            inside = changed(known.view(np.int8), np.zeros(known.shape, np.int8))
            extent.known = extent.known.joined(inside._replace(row=row * SIDE + inside.row, column=column * SIDE + inside.column))
            extent.known_cells += int(known.sum())
            extent.measured_cells += int(self.measured(tile).sum())
            seen_s = tile.seen_s[tile.seen_s > 0]
            if len(seen_s):
                extent.oldest_s = min(int(seen_s.min()), extent.oldest_s or int(seen_s.min()))
                extent.newest_s = max(int(seen_s.max()), extent.newest_s or 0)
        return extent

    def bands(
        self, where: Rectangle, plane: Callable[[Tile], NDArray[T]], dtype: type[T], on_progress: OnProgress | None = None
    ) -> Iterator[NDArray[T]]:
        """A rectangle of cells, by rows of tiles from the first on: `plane` (SIDE, SIDE) of each tile, 0 where there is none."""
        keys = set(self.keys)
        row = where.row
        while row < where.row + where.height:
            height = min((row // SIDE + 1) * SIDE, where.row + where.height) - row
            band = np.zeros((height, where.width), dtype=dtype)
            for key, inside, piece in pieces(row, where.column, height, where.width):
                tile = self.tile(key) if key in keys else None
                if tile is not None:
                    band[piece] = plane(tile)[inside]
            yield band
            row += height
            if on_progress is not None:
                on_progress((row - where.row) / where.height)

    def overview(self, longest: int, on_progress: OnProgress | None = None) -> tuple[Rectangle, int, LogOdds]:
        """The whole map with no more than `longest` cells along a side, for looking at: which cells, how many of them make one, log-odds.

        Raises EchogridError if the map is so wide that even that does not fit in memory.
        """
        rows, columns = zip(*self.keys, strict=True) if self.keys else ((0,), (0,))
        top, left = min(rows), min(columns)
        height, width = max(rows) - top + 1, max(columns) - left + 1
        step = 1
        while step * longest < max(height, width) * SIDE:
            step *= 2
        fine = min(step, SIDE)  # a tile is never less than one cell here
        if height * width * (SIDE // fine) ** 2 > MOST_CELLS:
            side = SIDE * self.description.cell / 1e3
            raise EchogridError(
                f"{self.store.path}: epoch {self.number}: spreads over {width * side:.0f} x {height * side:.0f} km, too far for a picture"
            )
        side = SIDE // fine
        seen = np.zeros((height * side, width * side), dtype=np.float32)
        for (row, column), tile in self.tiles(on_progress):
            row, column = (row - top) * side, (column - left) * side
            seen[row : row + side, column : column + side] = shrink(self.log_odds(tile), fine)
        return Rectangle(top * SIDE, left * SIDE, height * SIDE, width * SIDE), step, shrink(seen, step // fine)
