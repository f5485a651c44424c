"""The SQLite file of a store: its tables, how it is opened and made, and what goes wrong with it. docs/store.md is the format."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Literal, get_args

from echogrid.errors import EchogridError

SUFFIX = ".egmap"
APPLICATION_ID = 0x6567_6D70  # "egmp"
VERSION = 2
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
LEAST = 64 << 10  # bytes on the disk, below which SQLite cannot make the files that it keeps beside a database
PATIENCE = 5.0  # s that another writer of the same file is waited for
State = Literal["ok", "full", "read-only", "failed"]
STATES: tuple[State, ...] = get_args(State)
STATE_OF_ERROR: Mapping[int, State] = {sqlite3.SQLITE_FULL: "full", sqlite3.SQLITE_READONLY: "read-only"}


class StoreError(EchogridError):
    """A store that could not be read or written, and what state that is."""

    def __init__(self, sentence: str, state: State = "failed") -> None:
        super().__init__(sentence)
        self.state = state


class ForeignFileError(EchogridError):
    """A file that is not a store, or one of a newer version."""


def open_file(path: Path, write: bool) -> sqlite3.Connection:
    """A connection to a store; to write, the file is made where it is not. Raises StoreError and ForeignFileError."""
    with sqlite_errors(path), _closed_on_error(_connect(path, write)) as connection:
        if _is_empty(connection):
            if not write:
                raise StoreError(f"{path}: is empty")
            _create(connection)
        _check(connection, path)
        if write:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")  # a commit, every few seconds, survives a loss of power too
            connection.execute("PRAGMA secure_delete = OFF")  # some builds write zeros over all that goes: twice the wear of the disk
            connection.execute(f"PRAGMA journal_size_limit = {WAL_BYTES}")
        return connection


@contextmanager
def sqlite_errors(path: Path) -> Iterator[None]:
    """What SQLite and the disk raise, as StoreError; a file that is not a database, as ForeignFileError."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code == sqlite3.SQLITE_NOTADB:
            raise ForeignFileError(_foreign(path, "it is not an SQLite file")) from error
        state, why = _cause(code, path.absolute().parent, str(error))
        raise StoreError(f"{path}: {why}", state) from error
    except UnicodeDecodeError as error:  # of a name in the schema, or of what SQLite says of it
        raise StoreError(f"{path}: a text in it is not UTF-8") from error
    except OSError as error:  # of a disk that is dead, whose files cannot even be looked for
        raise StoreError(f"{path}: {error.strerror}") from error


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """All that is done within, or nothing."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:  # SQLite ends it by itself where the disk is full
            connection.execute("ROLLBACK")
        raise


def _connect(path: Path, write: bool) -> sqlite3.Connection:
    where, log = path.absolute().as_uri(), path.with_name(f"{path.name}-wal")
    if write:
        where += "?mode=rwc"
    elif not os.access(path.absolute().parent, os.W_OK) and not (log.exists() and log.stat().st_size):
        where += "?immutable=1"  # a file with a log is otherwise read only where its -shm file can be made; readers leave an empty log
    else:
        where += "?mode=ro"
    # Several threads, one after the other: the keeper's, and the one that ends the service.
    connection = sqlite3.connect(where, uri=True, timeout=PATIENCE, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA trusted_schema = OFF")  # nothing in a foreign file is run
    return connection


@contextmanager
def _closed_on_error(connection: sqlite3.Connection) -> Iterator[sqlite3.Connection]:
    try:
        yield connection
    except BaseException:
        connection.close()
        raise


def _cause(code: int, folder: Path, said: str) -> tuple[State, str]:
    """The state after an error of SQLite, and what to say of it."""
    try:
        if code == sqlite3.SQLITE_CANTOPEN and not folder.is_dir():
            return "failed", f"there is no folder {folder}"
        if code == sqlite3.SQLITE_CANTOPEN and not os.access(folder, os.W_OK):
            return "read-only", said
        if code == sqlite3.SQLITE_IOERR and folder.is_dir() and shutil.disk_usage(folder).free < LEAST:
            return "full", "the disk is full"  # SQLite says so of its database alone, not of what it keeps beside it
    except OSError:  # a dead disk cannot be asked
        pass
    return STATE_OF_ERROR.get(code, "failed"), said


def _is_empty(connection: sqlite3.Connection) -> bool:
    """Whether the file has no table and is nobody's: it has no page, or one, which SQLite writes when it hears of auto_vacuum."""
    counts = connection.execute("SELECT count(*) FROM sqlite_schema"), connection.execute("PRAGMA application_id")
    return [count.fetchone() for count in counts] == [(0,), (0,)]


def _create(connection: sqlite3.Connection) -> None:
    """All of it in one transaction, before the file is one with a WAL: who is killed here leaves an empty file, not half of one."""
    connection.execute("PRAGMA auto_vacuum = INCREMENTAL")
    connection.execute("BEGIN EXCLUSIVE")
    if _is_empty(connection):  # no other process has made it meanwhile
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
        cure = "update echogrid" if version > VERSION else "an older echogrid reads it"
        raise ForeignFileError(f"{path}: a map of version {version} found, expected {VERSION}: {cure}, or name another file")
    with closing(connection.execute("SELECT name, sql FROM sqlite_schema WHERE name NOT LIKE 'sqlite_%'")) as found:
        tables = dict(found.fetchall())
    if tables != TABLES:
        names = ", ".join(sorted(tables)) or "none"
        raise ForeignFileError(_foreign(path, f"tables {names} found, expected {', '.join(TABLES)} as this version makes them"))


def _foreign(path: Path, why: str) -> str:
    return f"{path}: is not a map of echogrid: {why}; name another file, or move this one away"
