"""The running map's tiles on disk: those that have no room in memory, and every few seconds all that changed. docs/store.md."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterable, Set
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

from echogrid.config import tables as config
from echogrid.core.map.tile import Tile, TileKey
from echogrid.core.map.tiled_map import TiledMap
from echogrid.store.claim import Claim
from echogrid.store.epoch import Description
from echogrid.store.store_file import ForeignFileError, State, StoreError
from echogrid.store.tile_data import unpacked
from echogrid.store.tile_store import TileStore

log = logging.getLogger("echogrid")
MOST_WAITING = 64  # tiles without room in memory that wait for the disk
LOOKS = 0.5  # s: whether to flush is asked so often at least
AT_ONCE = 32  # tiles that are packed to be written together
GOES_ON = "; mapping continues in memory"
Waiting = dict[tuple[int, TileKey], Tile | bytes]  # by epoch; as they are, or packed


@dataclass(slots=True)
class StoreStatus:
    """Of the last try, and counters since the start."""

    state: State = "ok"
    reason: str = ""
    epoch: int = 0  # of the running map
    mib: float = 0.0  # of the file
    written: int = 0  # tiles
    failed: int = 0  # tries to write that came to nothing
    forgotten: int = 0  # tiles of the running map that are lost: no room on the disk, or none to wait for one that cannot be written
    removed: int = 0  # older epochs that made room


def check_ours(path: Path) -> None:
    """Raises ForeignFileError where another file than one of ours is there; one that cannot be read is left to the keeper."""
    with suppress(StoreError), TileStore(path):
        pass


class TileKeeper:
    """The shelf of a running map, open from construction to `close` or the end of `with`.

    `lock` guards the map and all waiting tiles. Who changes the map holds it, so `load`, `store`, `keys` and `clear` are called with
    the lock held; `run` and `flush`, in one thread at a time, and `snapshot`, in any, take it for one tile's copy at a time. A disk that
    cannot be written is a state: the map continues in memory, and each flush reopens the file and retries.
    """

    def __init__(self, path: Path, settings: config.Store, occupancy: TiledMap, description: Description, lock: threading.Lock) -> None:
        """Begins an epoch. Raises EchogridError where the path is another file than one of ours, or one that another process writes."""
        self.path = path
        self.flush_s = settings.flush_s
        self.max_bytes = settings.max_mib << 20
        self.map = occupancy
        self.lock = lock
        self.status = StoreStatus()
        self._description = description
        self._waiting: Waiting = {}  # the longest first: on their way to the disk
        self._copied = Tile.empty(occupancy.layers)  # one after the other, while it is packed: pages that are new cost more than the copy
        self._stored: set[TileKey] = set()  # of the running epoch
        self._due_at = time.monotonic()
        self._writer: tuple[TileStore, int] | None = None  # and the file's inode
        self._readers: dict[str, TileStore] = {}  # a connection of its own for the mapping, and one for all others
        self._read_from = 0  # the file's inode, of the newest of these
        self._asking = threading.Lock()
        self._claim = Claim(path)
        self.epoch = self._first_epoch()
        self._claim.hold()
        self._begun_ns = {self.epoch: description.begun_ns}  # of the running epoch, and of those before it that wait
        self._ended_ns: dict[int, int] = {}  # of those before it: the newest update that is in them
        self._begun: set[int] = set()  # of these: those that the file has
        self.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Writes what is left; nothing uses it afterwards."""
        self.flush()
        self._close_readers()
        self._close_writer()  # last, so that it leaves one file, with nothing beside it
        self._claim.release()

    def run(self, stop: threading.Event) -> None:
        """Flushes whenever that is due, until `stop`."""
        while not stop.wait(min(self.flush_s, LOOKS)):
            if self.due():
                self.flush()

    def due(self) -> bool:
        """Whether it is time to `flush`: after `flush_s`, or when half the waiting room would be taken if a new map started now."""
        waiting = len(self._waiting) + len(self.map.dirty)
        return time.monotonic() >= self._due_at or (self.status.state == "ok" and waiting > MOST_WAITING / 2)

    def flush(self) -> None:
        """Writes all that waits, and all tiles that changed. Raises nothing: what went wrong is in `status`."""
        self._due_at = time.monotonic() + self.flush_s
        try:
            store = self._opened()
            self._write(store)
            with self.lock:
                changed = list(self.map.dirty)
            for first in range(0, len(changed), AT_ONCE):
                packed = self._pack(store, changed[first : first + AT_ONCE])
                try:
                    self._write(store)
                except StoreError:
                    self._take_back(packed)
                    raise
            crowded = self._make_room(store)
            self.status.mib = store.size() / (1 << 20)
        except (StoreError, ForeignFileError) as error:
            self.status.failed += 1
            self._close_writer()
            self._tell(error.state if isinstance(error, StoreError) else "failed", f"{error}{GOES_ON}")
        else:
            most = (
                f"{self.path}: the running map alone needs more than store.max_mib, {self.max_bytes >> 20} MiB: its oldest tiles are lost"
            )
            self._tell("full" if crowded else "ok", most if crowded else "")

    def load(self, key: TileKey) -> Tile | None:
        """Of the running epoch: a copy, for what waits may be on its way to the disk."""
        waiting = self._waiting.get((self.epoch, key))
        if waiting is not None:
            return self._copy(waiting)
        if key not in self._stored:
            return None
        tile = self._read("mapping", self.epoch, key)
        if tile is None:
            self._stored.discard(key)
            self.status.forgotten += 1
        return tile

    def store(self, key: TileKey, tile: Tile) -> None:
        """Waits for the next flush; beyond MOST_WAITING the tile that has waited longest is forgotten."""
        self._waiting.pop((self.epoch, key), None)
        if len(self._waiting) >= MOST_WAITING:
            del self._waiting[next(iter(self._waiting))]
            self.status.forgotten += 1
        self._waiting[self.epoch, key] = tile

    def keys(self) -> Set[TileKey]:
        """Of the running epoch."""
        return self._stored | {key for epoch, key in self._waiting if epoch == self.epoch}

    def clear(self, begun_ns: int) -> None:
        """The next epoch begins."""
        self._ended_ns[self.epoch] = self.map.stamp_ns
        self.epoch += 1
        self._begun_ns[self.epoch] = begun_ns
        self._stored = set()

    def snapshot(self, key: TileKey) -> Tile | None:
        """A tile of the running map as it is now, from memory or from the disk."""
        with self.lock:
            epoch = self.epoch
            tile = self.map.tiles.get(key) or self._waiting.get((epoch, key))
            if tile is not None:
                return self._copy(tile)
            if key not in self._stored:
                return None
        with self._asking:
            return self._read("asking", epoch, key)

    def _first_epoch(self) -> int:
        """Raises ForeignFileError. 1 where the disk cannot be read: should it turn out to hold others later, it will not be written."""
        with suppress(StoreError), TileStore(self.path) as store:
            return store.next_epoch()
        with suppress(StoreError):
            return self._opened().next_epoch()
        return 1

    def _opened(self) -> TileStore:
        """The file to write into. One that was moved away, removed or replaced is created again, with all tiles in memory."""
        now = _inode(self.path)
        if self._writer is not None and self._writer[1] != now:
            self._close_writer()
        if self._readers and now not in (0, self._read_from):
            self._close_readers()  # a file that was removed takes its room on the disk as long as it is open
        self._claim.hold()
        if self._writer is None:
            store = TileStore(self.path, write=True)
            self._writer = store, _inode(self.path)
            self._claim.hold()  # where it was made just now
            held = set(store.tiles(self.epoch)) if self._stored else set()
            if held != self._stored:
                self._close_readers()
                with self.lock:
                    self.status.forgotten += len(self._stored - held - self.map.tiles.keys())
                    self._stored = held
                    self.map.dirty |= self.map.tiles.keys() - held
        return self._writer[0]

    def _pack(self, store: TileStore, keys: Iterable[TileKey]) -> Waiting:
        """Tiles that changed, as they are now, each on its way to the disk."""
        packed: Waiting = {}
        for key in keys:
            with self.lock:
                if key not in self.map.dirty:  # any more: it may have had to leave the memory meanwhile
                    continue
                self.map.dirty.remove(key)
                where = self.epoch, key
                self._copied.become(self.map.tiles[key])
                self._waiting[where] = self._copied
            data = store.packed(self._copied)
            with self.lock:
                if self._waiting.get(where) is self._copied:  # not a newer one
                    self._waiting[where] = packed[where] = data
        return packed

    def _copy(self, tile: Tile | bytes) -> Tile:
        return unpacked(tile, self.map.layers) if isinstance(tile, bytes) else tile.copy()

    def _take_back(self, packed: Waiting) -> None:
        """What was not written and is in memory still need not wait: it has changed, as before."""
        with self.lock:
            for (epoch, key), tile in packed.items():
                if self._waiting.get((epoch, key)) is tile and epoch == self.epoch and key in self.map.tiles:
                    del self._waiting[epoch, key]
                    self.map.dirty.add(key)

    def _write(self, store: TileStore) -> None:
        """All that waits, an epoch in one transaction, the oldest first."""
        with self.lock:
            waiting, running, stamp_ns = dict(self._waiting), self.epoch, self.map.stamp_ns
        known = store.numbers()
        for epoch in sorted({running, *(epoch for epoch, _ in waiting)}):
            if not (epoch in known and epoch in self._begun):  # it refuses one that another process has started
                store.begin(replace(self._description, begun_ns=self._begun_ns[epoch]), epoch)
                self._begun.add(epoch)
            tiles = {key: tile for (of, key), tile in waiting.items() if of == epoch}
            if not tiles:
                continue
            store.write(epoch, tiles, stamp_ns if epoch == running else self._ended_ns[epoch])
            self.status.written += len(tiles)
            with self.lock:
                for key, tile in tiles.items():
                    if self._waiting.get((epoch, key)) is tile:  # not a newer one
                        del self._waiting[epoch, key]
                if epoch == self.epoch:
                    self._stored.update(tiles)
        with self.lock:
            self.status.epoch = self.epoch
            self._begun_ns = {epoch: begun_ns for epoch, begun_ns in self._begun_ns.items() if epoch >= running}
            self._ended_ns = {epoch: ended_ns for epoch, ended_ns in self._ended_ns.items() if epoch >= running}
            self._begun &= self._begun_ns.keys()

    def _make_room(self, store: TileStore) -> bool:
        """Removes older epochs first, whole; then the oldest tiles of the newest one. Returns whether any of those were removed."""
        crowded = False
        while store.used() > self.max_bytes:
            first, *later = store.numbers()
            if later:
                store.forget(first)
                self.status.removed += 1
                continue
            gone = store.forget_oldest(first)
            if not gone:
                break
            crowded = True
            with self.lock:
                if first == self.epoch:
                    self._stored.difference_update(gone)
            self.status.forgotten += len(gone)
        store.shrink(self.max_bytes)
        return crowded

    def _read(self, who: str, epoch: int, key: TileKey) -> Tile | None:
        try:
            if who not in self._readers:
                self._readers[who], self._read_from = TileStore(self.path), _inode(self.path)
            return self._readers[who].read(epoch, key)
        except (StoreError, ForeignFileError) as error:
            broken = self._readers.pop(who, None)
            if broken is not None:
                broken.close()
            self._tell("failed", str(error))
            return None

    def _close_readers(self) -> None:
        with self._asking, self.lock:
            while self._readers:
                self._readers.popitem()[1].close()

    def _close_writer(self) -> None:
        if self._writer is not None:
            with suppress(StoreError):
                self._writer[0].close()
            self._writer = None

    def _tell(self, state: State, reason: str) -> None:
        """The journal of a change."""
        if state != self.status.state:
            if state == "ok":
                log.info("%s: is written again", self.path)
            else:
                log.warning("%s", reason)
        self.status.state, self.status.reason = state, reason


def _inode(path: Path) -> int:
    """0 if there is no file."""
    try:
        return path.stat().st_ino
    except OSError:
        return 0
