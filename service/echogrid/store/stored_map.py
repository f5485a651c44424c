"""An epoch of a store as a map, and what a store has to know of a map for that."""

from __future__ import annotations

from collections.abc import Set

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import Tile, TileKey
from echogrid.core.map.tiled_map import TiledMap
from echogrid.store.epoch import Description, Kind
from echogrid.store.tile_store import TileStore

STORED_TILES = 64  # of a stored map that are in memory at a time


class _StoredTiles:
    """A shelf that only gives."""

    def __init__(self, store: TileStore, epoch: int) -> None:
        self._store, self._epoch = store, epoch
        self._keys = frozenset(store.tiles(epoch))

    def load(self, key: TileKey) -> Tile | None:
        return self._store.read(self._epoch, key) if key in self._keys else None

    def keys(self) -> Set[TileKey]:
        return self._keys

    def store(self, key: TileKey, tile: Tile) -> None:
        raise TypeError("a stored map is read only")

    def clear(self, begun_ns: int) -> None:
        raise TypeError("a stored map is read only")


def stored_map(store: TileStore, epoch: int) -> TiledMap:
    """An epoch as a read-only map: its tiles are read from the store when they are needed. Raises EchogridError."""
    description = store.description(epoch)
    spec = GridSpec(cell=description.cell)
    occupancy: TiledMap
    if description.kind == "looks":
        occupancy = LookMap(spec, description.calibration, description.clamp, STORED_TILES)
    else:
        occupancy = OccupancyMap(spec, description.clamp, STORED_TILES)
    occupancy.shelf = _StoredTiles(store, epoch)
    return occupancy


def describe(occupancy: TiledMap, vehicle: str, radars: tuple[str, ...], begun_ns: int) -> Description:
    """What `stored_map` needs to make such a map again."""
    kind: Kind = "looks" if isinstance(occupancy, LookMap) else "sum"
    calibration = occupancy.calibration if isinstance(occupancy, LookMap) else Calibration()
    return Description(begun_ns, vehicle, occupancy.spec.cell, kind, occupancy.clamp, calibration, radars)
