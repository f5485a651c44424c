"""Parts of the map while it is being made, and of those that are on disk."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

import numpy as np

from echogrid.core.map.map_delta import Rectangle
from echogrid.core.map.tile import Tile, TileKey
from echogrid.core.map.tiled_map import TiledMap, pieces
from echogrid.core.mapper import Mapper
from echogrid.errors import EchogridError
from echogrid.store.store_file import StoreError
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_keeper import TileKeeper
from echogrid.store.tile_store import TileStore
from echogrid.zenoh.region import Part

log = logging.getLogger("echogrid")
Load = Callable[[TileKey], Tile | None]  # a copy of a tile; None if there is none


class MapReader:
    """Reads tile by tile, so that the mapping never waits longer than for the copy of one. One thread at a time."""

    def __init__(self, mapper: Mapper, lock: threading.Lock, keeper: TileKeeper | None) -> None:
        """`lock`: held by the mapping while it changes the map."""
        self.mapper = mapper
        self.lock = lock
        self.keeper = keeper

    def part(self, where: Rectangle, epoch: int | None) -> Part:
        """Of the running map (None), or of one by its number. Raises EchogridError if there is none with that number."""
        while epoch in (None, now := self.mapper.epoch):
            part = _read(where, now, self._load, self.mapper.map)
            if self.mapper.epoch == now:  # else a new map has started meanwhile, and the part is from both
                return part
        try:
            return self._stored(where, int(epoch or 0), now)
        except StoreError as error:
            log.warning("a part of an older map cannot be read: %s", error)
            raise EchogridError(f"epoch: {epoch} cannot be read from the store") from error

    def _load(self, key: TileKey) -> Tile | None:
        if self.keeper is not None:
            return self.keeper.snapshot(key)
        with self.lock:
            tile = self.mapper.map.tiles.get(key)
            return None if tile is None else tile.copy()

    def _stored(self, where: Rectangle, epoch: int, now: int) -> Part:
        if self.keeper is None:
            raise EchogridError(f"epoch: {epoch} found, expected {now}: this service stores no maps")
        with TileStore(self.keeper.path) as store:
            known = {stored.id: stored.description.cell for stored in store.epochs()}
            if epoch not in known:
                raise EchogridError(f"epoch: {epoch} found, expected {', '.join(map(str, sorted({*known, now})))}")
            cell = self.mapper.map.spec.cell
            if known[epoch] != cell:
                raise EchogridError(f"epoch: {epoch} has cells of {known[epoch]} m, expected {cell} m as now")
            return _read(where, epoch, lambda tile: store.read(epoch, tile), stored_map(store, epoch))


def _read(where: Rectangle, epoch: int, load: Load, rule: TiledMap) -> Part:
    """The part of a map out of its tiles, read out as `rule` does."""
    log_odds = np.zeros((where.height, where.width), dtype=np.float32)
    seen_s = 0
    for key, inside, piece in pieces(*where):
        tile = load(key)
        if tile is not None:
            log_odds[piece] = rule.read(tile.layers[:, *inside])
            seen_s = max(seen_s, int(tile.seen_s[inside].max()))
    return Part(epoch, seen_s * 10**9, log_odds)
