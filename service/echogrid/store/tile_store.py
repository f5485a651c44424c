"""Maps on disk: the tiles of one or more epochs in a file, read and written. docs/store.md is the format."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

import zstandard

from echogrid.core.map.tile import Tile, TileKey
from echogrid.errors import EchogridError
from echogrid.store.epoch import LAYERS, Description, Epoch, description_of, row_of
from echogrid.store.store_file import StoreError, open_file, sqlite_errors, transaction
from echogrid.store.tile_data import Packer, unpacked

OLDEST = 64  # tiles that are removed at once if there is no room


class TileStore:
    """One connection to a file, open from construction to `close` or the end of `with`; one thread at a time uses it.

    To be read, the file must exist. To be written, it is created if needed; others may read it meanwhile, each with its own connection.
    Every method raises StoreError, naming the file, if the disk or the file fails.
    """

    def __init__(self, path: Path, *, write: bool = False) -> None:
        """Raises ForeignFileError if the file is not a store of tiles, or one that only a newer version reads; it is left as it is."""
        self.path = path
        self._connection = open_file(path, write)
        self._packer = Packer()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """A second time does nothing."""
        with sqlite_errors(self.path):
            self._connection.close()

    def epochs(self) -> tuple[Epoch, ...]:
        """The oldest first."""
        with sqlite_errors(self.path):
            rows = self._connection.execute(
                "SELECT id, begun_ns, vehicle, cell, kind, clamp, calibration, radars, n, bytes, newest FROM epoch LEFT JOIN"
                " (SELECT epoch, count(*) AS n, sum(length(data)) AS bytes, max(stamp_ns) AS newest FROM tile GROUP BY epoch)"
                " ON epoch = id ORDER BY id"
            ).fetchall()
        return tuple(Epoch(row[0], description_of(row, self.path), row[8] or 0, row[9] or 0, row[10]) for row in rows)

    def description(self, epoch: int) -> Description:
        """Raises EchogridError if there is no such epoch."""
        with sqlite_errors(self.path):
            row = self._connection.execute(
                "SELECT id, begun_ns, vehicle, cell, kind, clamp, calibration, radars FROM epoch WHERE id = ?", (epoch,)
            ).fetchone()
            if row is None:
                known = ", ".join(map(str, self.numbers()))
                raise EchogridError(f"{self.path}: epoch {epoch} is not there, found {known or 'none at all'}")
        return description_of(row, self.path)

    def numbers(self) -> list[int]:
        """Of all epochs, the oldest first."""
        with sqlite_errors(self.path):
            return [number for (number,) in self._connection.execute("SELECT id FROM epoch ORDER BY id")]

    def next_epoch(self) -> int:
        """The number that `begin` gives to the next one: above all that there ever were."""
        with sqlite_errors(self.path):
            ((newest,),) = self._connection.execute("SELECT coalesce(max(seq), 0) FROM sqlite_sequence WHERE name = 'epoch'")
        return int(newest) + 1

    def begin(self, description: Description, epoch: int | None = None) -> int:
        """A new epoch's number: `next_epoch()`, or a given one above all others. Epochs before it without tiles are removed."""
        with sqlite_errors(self.path), transaction(self._connection):
            number = self.next_epoch()
            if epoch is not None and epoch < number:
                raise StoreError(f"{self.path}: epoch {epoch} should start, but {number - 1} has started: another process writes this file")
            number = number if epoch is None else epoch
            self._connection.execute("INSERT INTO epoch VALUES (?, ?, ?, ?, ?, ?, ?, ?)", (number, *row_of(description)))
            self._connection.execute("DELETE FROM epoch WHERE id < ? AND id NOT IN (SELECT epoch FROM tile)", (number,))
        return number

    def tiles(self, epoch: int) -> list[TileKey]:
        """Of an epoch, by row and column."""
        with sqlite_errors(self.path):
            return self._connection.execute("SELECT row, col FROM tile WHERE epoch = ? ORDER BY row, col", (epoch,)).fetchall()

    def read(self, epoch: int, tile: TileKey) -> Tile | None:
        """None if there is none. Raises StoreError if its data is damaged."""
        with sqlite_errors(self.path):
            row = self._connection.execute(
                "SELECT data, kind FROM tile JOIN epoch ON epoch = id WHERE epoch = ? AND row = ? AND col = ?", (epoch, *tile)
            ).fetchone()
        if row is None:
            return None
        try:
            return unpacked(row[0], LAYERS[row[1]])
        except (ValueError, KeyError, TypeError, zstandard.ZstdError) as error:
            raise StoreError(f"{self.path}: tile {tile} of epoch {epoch} is damaged: {error}") from error

    def stamp_ns(self, epoch: int, tile: TileKey) -> int | None:
        """Of the newest update that was in the map when the tile was written, Unix time. None if there is none."""
        with sqlite_errors(self.path):
            row = self._connection.execute("SELECT stamp_ns FROM tile WHERE epoch = ? AND row = ? AND col = ?", (epoch, *tile)).fetchone()
        return None if row is None else int(row[0])

    def packed(self, tile: Tile) -> bytes:
        """What `write` takes in place of a tile, and less to keep until then."""
        return self._packer.pack(tile)

    def write(self, epoch: int, tiles: Mapping[TileKey, Tile | bytes], stamp_ns: int) -> None:
        """All of them or none; those that are there already are replaced. `stamp_ns`: of the newest update in them, Unix time."""
        rows = (
            (epoch, *key, stamp_ns, tile if isinstance(tile, bytes) else self.packed(tile))  # one at a time
            for key, tile in tiles.items()
        )
        with sqlite_errors(self.path), transaction(self._connection):
            self._connection.executemany("INSERT OR REPLACE INTO tile VALUES (?, ?, ?, ?, ?)", rows)

    def forget(self, epoch: int) -> None:
        """An epoch and its tiles. The file keeps its size, and what comes next has room in it; `shrink` gives it back."""
        with sqlite_errors(self.path), transaction(self._connection):
            self._connection.execute("DELETE FROM tile WHERE epoch = ?", (epoch,))
            self._connection.execute("DELETE FROM epoch WHERE id = ?", (epoch,))

    def forget_oldest(self, epoch: int) -> list[TileKey]:
        """The OLDEST tiles of an epoch that were written longest ago; which they were."""
        which = "SELECT row, col FROM tile WHERE epoch = ? ORDER BY stamp_ns, row, col LIMIT ?"
        with sqlite_errors(self.path), transaction(self._connection):
            keys: list[TileKey] = self._connection.execute(which, (epoch, OLDEST)).fetchall()
            self._connection.executemany("DELETE FROM tile WHERE epoch = ? AND row = ? AND col = ?", [(epoch, *key) for key in keys])
        return keys

    def used(self) -> int:
        """Bytes of the file that hold something."""
        with sqlite_errors(self.path):
            return (self._pragma("page_count") - self._pragma("freelist_count")) * self._pragma("page_size")

    def size(self) -> int:
        """Bytes of the file."""
        with sqlite_errors(self.path):
            return self._pragma("page_count") * self._pragma("page_size")

    def seal(self) -> None:
        """After the last write: the file alone holds everything, and is read from where nothing can be written, or over a network, too."""
        with sqlite_errors(self.path):
            self._connection.execute("PRAGMA journal_mode = DELETE").fetchall()

    def shrink(self, most: int | None = None) -> None:
        """Gives room that is not used back to the file system, so that the file has no more than `most` bytes if that can be; None: all."""
        with sqlite_errors(self.path):
            pages = 0 if most is None else math.ceil((self.size() - most) / self._pragma("page_size"))  # 0: all
            if most is None or pages > 0:
                self._connection.executescript(f"PRAGMA incremental_vacuum({pages})")  # `execute` would take its first step alone
                self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    def _pragma(self, key: str) -> int:
        return int(self._connection.execute(f"PRAGMA {key}").fetchone()[0])
