"""Maps on disk: an SQLite file with the tiles of one or more epochs. docs/store.md is the format."""

from __future__ import annotations

import math
import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self, get_args

import msgspec
import zstandard

from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tile import MOST_RADARS, Tile, TileKey
from echogrid.errors import EchogridError
from echogrid.store.tile_data import decode, encode

SUFFIX = ".egmap"
APPLICATION_ID = 0x6567_6D70  # "egmp"
VERSION = 1
TABLES = {
    "epoch": """CREATE TABLE epoch(
 id INTEGER PRIMARY KEY AUTOINCREMENT,
 begun_ns INTEGER NOT NULL,
 vehicle TEXT NOT NULL,
 cell REAL NOT NULL,
 kind TEXT NOT NULL,
 clamp REAL NOT NULL,
 calibration TEXT NOT NULL,
 radars TEXT NOT NULL)""",
    "tile": """CREATE TABLE tile(
 epoch INTEGER NOT NULL,
 row INTEGER NOT NULL,
 col INTEGER NOT NULL,
 stamp_ns INTEGER NOT NULL,
 data BLOB NOT NULL,
 PRIMARY KEY(epoch, row, col)) WITHOUT ROWID""",
}
WAL_BYTES = 4 << 20  # what the -wal file is cut to when it has been taken over
PATIENCE = 5.0  # s that another writer of the same file is waited for
OLDEST = 64  # tiles that go at once where there is no room
Kind = Literal["looks", "sum"]
LAYERS: Mapping[Kind, int] = {"looks": LookMap.layers, "sum": OccupancyMap.layers}
State = Literal["ok", "full", "read-only", "failed"]
STATES: tuple[State, ...] = get_args(State)
STATE_OF_ERROR: Mapping[int, State] = {sqlite3.SQLITE_FULL: "full", sqlite3.SQLITE_READONLY: "read-only"}


class StoreError(EchogridError):
    """A store that could not be read or written, and what state that is."""

    def __init__(self, sentence: str, state: State = "failed") -> None:
        super().__init__(sentence)
        self.state = state


class ForeignFileError(EchogridError):
    """A file that is no store, or one of a newer version."""


@dataclass(frozen=True, slots=True)
class Description:
    """What has to be known to read an epoch's tiles."""

    begun_ns: int  # Unix time
    vehicle: str
    cell: float  # m
    kind: Kind
    clamp: float  # log-odds
    calibration: Calibration  # of `looks`; as it is by default for `sum`
    radars: tuple[str, ...]  # in the order of the bits of Tile.radars

    @property
    def layers(self) -> int:
        """Of its tiles."""
        return LAYERS[self.kind]


@dataclass(frozen=True, slots=True)
class Epoch:
    """One map of a store."""

    id: int
    description: Description
    tiles: int
    bytes: int  # of its tiles' data
    newest_ns: int | None  # newest stamp of a tile; None where there is none


class TileStore:
    """One connection to a file, open from construction to `close` or the end of `with`; one thread at a time uses it.

    Read only, the file must be there. To write it is made where it is not; others may read it meanwhile, each with a connection of its own.
    Every method raises StoreError, naming the file, where the disk or the file lets it down.
    """

    def __init__(self, path: Path, *, write: bool = False) -> None:
        """Raises ForeignFileError where the file is no store of tiles, or one that only a newer version reads; it is left as it is."""
        self.path = path
        with self._told(), _closed_on_error(_connect(path, write)) as connection:
            if connection.execute("PRAGMA page_count").fetchone()[0] == 0:
                if not write:
                    raise StoreError(f"{path}: is empty")
                _create(connection)
            _check(connection, path)
            if write:
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = FULL")  # a commit, every few seconds, survives a loss of power too
                connection.execute("PRAGMA secure_delete = OFF")  # some builds write zeros over all that goes: twice the wear of the disk
                connection.execute(f"PRAGMA journal_size_limit = {WAL_BYTES}")
            self._connection = connection

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """A second time does nothing."""
        with self._told():
            self._connection.close()

    def epochs(self) -> tuple[Epoch, ...]:
        """The oldest first."""
        with self._told():
            rows = self._connection.execute(
                "SELECT id, begun_ns, vehicle, cell, kind, clamp, calibration, radars, n, bytes, newest FROM epoch LEFT JOIN"
                " (SELECT epoch, count(*) AS n, sum(length(data)) AS bytes, max(stamp_ns) AS newest FROM tile GROUP BY epoch)"
                " ON epoch = id ORDER BY id"
            ).fetchall()
        return tuple(Epoch(row[0], self._description(row), row[8] or 0, row[9] or 0, row[10]) for row in rows)

    def description(self, epoch: int) -> Description:
        """Raises EchogridError where there is no such epoch."""
        with self._told():
            row = self._connection.execute(
                "SELECT id, begun_ns, vehicle, cell, kind, clamp, calibration, radars FROM epoch WHERE id = ?", (epoch,)
            ).fetchone()
            if row is None:
                known = ", ".join(map(str, self.numbers()))
                raise EchogridError(f"{self.path}: epoch {epoch} is not there, found {known or 'none at all'}")
        return self._description(row)

    def numbers(self) -> list[int]:
        """Of all epochs, the oldest first."""
        with self._told():
            return [number for (number,) in self._connection.execute("SELECT id FROM epoch ORDER BY id")]

    def next_epoch(self) -> int:
        """The number that `begin` gives to the next one: above all that there ever were."""
        with self._told():
            ((newest,),) = self._connection.execute("SELECT coalesce(max(seq), 0) FROM sqlite_sequence WHERE name = 'epoch'")
        return int(newest) + 1

    def begin(self, description: Description, epoch: int | None = None) -> int:
        """A new epoch's number: `next_epoch()`, or a given one above all others. Epochs before it that hold no tile go."""
        texts = [msgspec.json.encode(value).decode() for value in (_pair(description.calibration), description.radars)]
        values = (description.begun_ns, description.vehicle, description.cell, description.kind, description.clamp, *texts)
        with self._told(), self._transaction():
            number = self.next_epoch()
            if epoch is not None and epoch < number:
                raise StoreError(f"{self.path}: epoch {epoch} is to begin, but {number - 1} has begun: another process writes this file")
            number = number if epoch is None else epoch
            self._connection.execute("INSERT INTO epoch VALUES (?, ?, ?, ?, ?, ?, ?, ?)", (number, *values))
            self._connection.execute("DELETE FROM epoch WHERE id < ? AND id NOT IN (SELECT epoch FROM tile)", (number,))
        return number

    def tiles(self, epoch: int) -> list[TileKey]:
        """Of an epoch, by row and column."""
        with self._told():
            return self._connection.execute("SELECT row, col FROM tile WHERE epoch = ? ORDER BY row, col", (epoch,)).fetchall()

    def read(self, epoch: int, tile: TileKey) -> Tile | None:
        """None where there is none. Raises StoreError where its data is damaged."""
        with self._told():
            row = self._connection.execute(
                "SELECT data, kind FROM tile JOIN epoch ON epoch = id WHERE epoch = ? AND row = ? AND col = ?", (epoch, *tile)
            ).fetchone()
        if row is None:
            return None
        try:
            return decode(row[0], LAYERS[row[1]])
        except (ValueError, KeyError, TypeError, zstandard.ZstdError) as error:
            raise StoreError(f"{self.path}: tile {tile} of epoch {epoch} is damaged: {error}") from error

    def stamp_ns(self, epoch: int, tile: TileKey) -> int | None:
        """Of the newest update that was in the map when the tile was written, Unix time. None where there is none."""
        with self._told():
            row = self._connection.execute("SELECT stamp_ns FROM tile WHERE epoch = ? AND row = ? AND col = ?", (epoch, *tile)).fetchone()
        return None if row is None else int(row[0])

    def write(self, epoch: int, tiles: Mapping[TileKey, Tile], stamp_ns: int) -> None:
        """All of them or none; those that are there already are replaced. `stamp_ns`: of the newest update in them, Unix time."""
        rows = [(epoch, *key, stamp_ns, encode(tile)) for key, tile in tiles.items()]
        with self._told(), self._transaction():
            self._connection.executemany("INSERT OR REPLACE INTO tile VALUES (?, ?, ?, ?, ?)", rows)

    def forget(self, epoch: int) -> None:
        """An epoch and its tiles. The file keeps its size, and what comes next has room in it; `shrink` gives it back."""
        with self._told(), self._transaction():
            self._connection.execute("DELETE FROM tile WHERE epoch = ?", (epoch,))
            self._connection.execute("DELETE FROM epoch WHERE id = ?", (epoch,))

    def forget_oldest(self, epoch: int) -> list[TileKey]:
        """The OLDEST tiles of an epoch that were written longest ago; which they were."""
        which = "SELECT row, col FROM tile WHERE epoch = ? ORDER BY stamp_ns, row, col LIMIT ?"
        with self._told(), self._transaction():
            keys: list[TileKey] = self._connection.execute(which, (epoch, OLDEST)).fetchall()
            self._connection.executemany("DELETE FROM tile WHERE epoch = ? AND row = ? AND col = ?", [(epoch, *key) for key in keys])
        return keys

    def used(self) -> int:
        """Bytes of the file that hold something."""
        with self._told():
            return (self._pragma("page_count") - self._pragma("freelist_count")) * self._pragma("page_size")

    def size(self) -> int:
        """Bytes of the file."""
        with self._told():
            return self._pragma("page_count") * self._pragma("page_size")

    def seal(self) -> None:
        """After the last write: the file alone holds everything, and is read from where nothing can be written, or over a network, too."""
        with self._told():
            self._connection.execute("PRAGMA journal_mode = DELETE").fetchall()

    def shrink(self, most: int | None = None) -> None:
        """Gives room that is not used back to the file system, so that the file has no more than `most` bytes if that can be; None: all."""
        with self._told():
            pages = 0 if most is None else math.ceil((self.size() - most) / self._pragma("page_size"))  # 0: all
            if most is None or pages > 0:
                self._connection.executescript(f"PRAGMA incremental_vacuum({pages})")  # `execute` would take its first step alone
                self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()

    def _pragma(self, key: str) -> int:
        return int(self._connection.execute(f"PRAGMA {key}").fetchone()[0])

    def _description(self, row: tuple[Any, ...]) -> Description:
        epoch, begun_ns, vehicle, cell, kind, clamp, calibration, radars = row[:8]
        try:
            a, b = msgspec.json.decode(calibration, type=tuple[float, float])
            names = msgspec.json.decode(radars, type=tuple[str, ...])
        except (msgspec.DecodeError, TypeError) as error:
            raise StoreError(f"{self.path}: epoch {epoch}: calibration or radars cannot be read: {error}") from error
        sound = (
            kind in LAYERS
            and isinstance(begun_ns, int)
            and isinstance(vehicle, str)
            and all(isinstance(number, float) and 0 < number < 1e6 for number in (cell, clamp))
            and math.isfinite(a)
            and math.isfinite(b)
            and len(names) <= MOST_RADARS
        )
        if not sound:
            raise StoreError(f"{self.path}: epoch {epoch} is damaged: kind '{kind}', cells of {cell} m, clamp {clamp}, {len(names)} radars")
        return Description(begun_ns, vehicle, cell, kind, clamp, Calibration(a, b), names)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:  # SQLite ends it by itself where the disk is full
                self._connection.execute("ROLLBACK")
            raise

    @contextmanager
    def _told(self) -> Iterator[None]:
        """What SQLite raises, as StoreError; what is no database, as ForeignFileError."""
        try:
            yield
        except sqlite3.Error as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            if code == sqlite3.SQLITE_NOTADB:
                raise ForeignFileError(_foreign(self.path, "it is no SQLite file")) from error
            state = STATE_OF_ERROR.get(code, "failed")
            if code == sqlite3.SQLITE_CANTOPEN and not os.access(self.path.absolute().parent, os.W_OK):
                state = "read-only"
            raise StoreError(f"{self.path}: {error}", state) from error
        except UnicodeDecodeError as error:  # of a name in the schema, or of what SQLite says of it
            raise StoreError(f"{self.path}: a text in it is no UTF-8") from error


def _connect(path: Path, write: bool) -> sqlite3.Connection:
    where = path.absolute().as_uri()
    if write:
        where += "?mode=rwc"
    elif not os.access(path.absolute().parent, os.W_OK) and not path.with_name(f"{path.name}-wal").exists():
        where += "?immutable=1"  # a WAL file is otherwise read only where its -shm file can be made
    else:
        where += "?mode=ro"
    # Several threads, one after the other: the keeper's, and the one that ends the service.
    connection = sqlite3.connect(where, uri=True, timeout=PATIENCE, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA trusted_schema = OFF")  # nothing that a foreign file brings along is run
    return connection


@contextmanager
def _closed_on_error(connection: sqlite3.Connection) -> Iterator[sqlite3.Connection]:
    try:
        yield connection
    except BaseException:
        connection.close()
        raise


def _create(connection: sqlite3.Connection) -> None:
    """All of it in one transaction, before the file is one with a WAL: a process that is killed here leaves nothing, not half of it."""
    connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
    connection.execute("BEGIN EXCLUSIVE")
    if connection.execute("SELECT count(*) FROM sqlite_schema").fetchone() == (0,):  # nobody else has made it meanwhile
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {VERSION}")
        for table in TABLES.values():
            connection.execute(table)
    connection.execute("COMMIT")


def _check(connection: sqlite3.Connection, path: Path) -> None:
    """Raises ForeignFileError."""
    (application_id,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application_id != APPLICATION_ID:
        raise ForeignFileError(_foreign(path, f"application id 0x{application_id & 0xFFFFFFFF:08X} found, expected 0x{APPLICATION_ID:08X}"))
    if version != VERSION:
        raise ForeignFileError(f"{path}: a map of version {version} found, expected {VERSION}: update echogrid, or name another file")
    with closing(connection.execute("SELECT name, sql FROM sqlite_schema WHERE name NOT LIKE 'sqlite_%'")) as found:
        tables = dict(found.fetchall())
    if tables != TABLES:
        names = ", ".join(sorted(tables)) or "none"
        raise ForeignFileError(_foreign(path, f"tables {names} found, expected {', '.join(TABLES)} as this version makes them"))


def _foreign(path: Path, why: str) -> str:
    return f"{path}: is no map of echogrid: {why}; name another file, or move this one away"


def _pair(calibration: Calibration) -> tuple[float, float]:
    return calibration.learned, calibration.offset
