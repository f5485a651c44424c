"""Stored maps for tests: tiles of noise in epochs, and all that a store holds, to compare."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from echogrid.core.map.look_map import Calibration
from echogrid.core.map.tile import SIDE, Tile, TileKey
from echogrid.store.epoch import Description
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore

CELL = 0.25
LEARNED = Calibration(1.5, -0.25)
NAMES = ("left", "right", "rear")
LOOKS = Description(17, "car", 0.25, "looks", 3.5, Calibration(1.2, -0.1), ("front", "rear"))
SUM = Description(18, "car", 0.25, "sum", 3.0, Calibration(), ("front",))
Tiles = dict[TileKey, Tile]


def described(kind: str = "looks", names: tuple[str, ...] = NAMES, cell: float = CELL, vehicle: str = "car") -> Description:
    return Description(1_700_000_000_000_000_000, vehicle, cell, kind, 3.5, LEARNED if kind == "looks" else Calibration(), names)


def random_tiles(seed: int, keys: tuple[TileKey, ...] = ((0, 0), (0, 1), (-1, 3)), kind: str = "looks") -> Tiles:
    rng = np.random.default_rng(seed)
    tiles = {}
    for key in keys:
        tile = tiles[key] = Tile.empty(5 if kind == "looks" else 1)
        some = rng.uniform(size=(SIDE, SIDE)) < 0.1
        some[:20] = False
        tile.layers[:] = np.where(some, rng.normal(0, 1, tile.layers.shape).clip(-3.5, 3.5), 0)
        if kind == "looks":
            tile.layers[1] = np.where(some, rng.uniform(0.25, 5, some.shape), 0)
            tile.layers[2:] = np.where(some, rng.integers(0, 9, (3, *some.shape)), 0)
            tile.layers[2:, rng.uniform(size=some.shape) < 0.5] = 0
        tile.seen_s[:] = np.where(some, rng.integers(1_700_000_000, 1_700_000_900, some.shape), 0)
        tile.radars[:] = np.where(some, rng.integers(1, 8, some.shape), 0)
    return tiles


def write_store(path: Path, tiles: Tiles, what: Description | None = None) -> Path:
    """A new epoch of it; every tile has a stamp of its own."""
    with TileStore(path, write=True) as store:
        number = store.begin(what or described())
        for n, (key, tile) in enumerate(tiles.items()):
            store.write(number, {key: tile}, 1_700_000_000_000_000_000 + n)
        store.seal()
    return path


def content(path: Path, epoch: int | None = None) -> str:
    """A hash of an epoch: what it is, and every bit of every tile."""
    digest = hashlib.sha256()
    with TileStore(path) as store:
        number = store.epochs()[-1].id if epoch is None else epoch
        digest.update(repr(store.description(number)).encode())
        for key in store.tiles(number):
            tile = store.read(number, key)
            assert tile is not None
            digest.update(repr(key).encode() + tile.layers.tobytes() + tile.seen_s.tobytes() + tile.radars.tobytes())
    return digest.hexdigest()


def window(path: Path, epoch: int | None = None) -> tuple[np.ndarray, tuple[float, float]]:
    """All known cells by the map's own reading, and where they begin."""
    with TileStore(path) as store:
        number = store.epochs()[-1].id if epoch is None else epoch
        cell = store.description(number).cell
        row, column, log_odds = stored_map(store, number).whole()
    return log_odds, (column * cell, row * cell)


def three_epochs(path: Path) -> Path:
    """Of `sum`, without tiles, and the newest one, of `looks`."""
    write_store(path, random_tiles(1, kind="sum"), described("sum"))
    write_store(path, {})
    return write_store(path, random_tiles(2))


def random_tile(rng: np.random.Generator, layers: int = 5) -> Tile:
    """Every bit is noise."""
    return Tile(
        rng.normal(size=(layers, SIDE, SIDE)).astype(np.float32),
        rng.integers(0, 2**32, (SIDE, SIDE), dtype=np.uint32),
        rng.integers(0, 2**16, (SIDE, SIDE), dtype=np.uint16),
    )


def same(one: Tile | None, other: Tile) -> bool:
    """Bit for bit."""
    assert one is not None
    return all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in ("layers", "seen_s", "radars"))


def filled(path: Path, tiles: int = 30) -> dict[TileKey, Tile]:
    """A store with one epoch, and what is in it."""
    rng = np.random.default_rng(5)
    made = {(n, 0): random_tile(rng) for n in range(tiles)}
    with TileStore(path, write=True) as store:
        store.write(store.begin(LOOKS), made, 5)
    return made
