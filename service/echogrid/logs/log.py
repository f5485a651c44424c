"""Recordings of CAN traffic, by the file's ending: every format that python-can reads, and our own."""

from __future__ import annotations

import gzip
import io
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import can
from can.io.player import MESSAGE_READERS

from echogrid.errors import EchogridError
from echogrid.logs.blf import Blf

LONGEST_LINE = 1 << 16  # characters
END_OF_TIME = 2**31  # s, either way of 1970: what ROS's stamps hold
TEXT, BINARY, BY_PATH, OURS = (".asc", ".csv", ".log", ".trc"), (".blf",), (".db", ".mf4"), (".mcap",)
EXTRAS = {  # what reads an ending, where it is not installed with the service
    ".mf4": "the package asammdf: pip install asammdf",
    ".mcap": "the extra mcap: pip install 'echogrid[mcap]'",
}


class Log:
    """Iterates over the messages of a recording, in the file's order. `progress` is the share of the file read so far, 0 to 1.

    Raises EchogridError where the file cannot be read: at once for an unknown ending or a missing file, in the course of it for
    garbage or a torn end, after the last message that could be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.messages = 0
        suffixes = [suffix.lower() for suffix in path.suffixes]
        self._zipped = suffixes[-1:] == [".gz"]
        self._suffix = "".join(suffixes[-2:-1] if self._zipped else suffixes[-1:])
        if self._suffix not in (*MESSAGE_READERS, *OURS) or (self._zipped and self._suffix in (*BY_PATH, *OURS)):
            expected = " ".join((*TEXT, *BINARY, *BY_PATH, *OURS))
            raise EchogridError(f"{path}: is not a known log format, expected one of {expected} (text and .blf also with .gz)")
        try:
            self._size = path.stat().st_size
            self._raw = path.open("rb")
        except OSError as error:
            raise EchogridError(f"{path}: cannot be read: {error.strerror}") from error

    @property
    def progress(self) -> float:
        return 1.0 if self._raw.closed or not self._size else self._raw.tell() / self._size

    def __iter__(self) -> Iterator[can.Message]:
        try:
            with self._raw:
                reader = self._reader()  # kept until the file is closed: what it wraps would else complain
                for message in reader:
                    _check(message)
                    self.messages += 1
                    yield message
        except (EchogridError, GeneratorExit):
            raise
        except ImportError as error:
            needed = EXTRAS.get(self._suffix, str(error))
            raise EchogridError(f"{self.path}: reading {self._suffix} files needs {needed}") from error
        except Exception as error:  # python-can's readers raise whatever garbage makes them stumble over
            what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            raise EchogridError(f"{self.path}: cannot be read beyond message {self.messages}: {what}") from error
        if not self.messages:
            raise EchogridError(f"{self.path}: holds no CAN message")

    def _reader(self) -> Any:
        if self._suffix in OURS:
            from echogrid.logs.mcap_log import McapLog  # an extra

            return McapLog(self._raw)
        reader: Any = Blf if self._suffix == ".blf" else MESSAGE_READERS[self._suffix]
        if self._suffix == ".db":
            _check_database(self.path)
        if self._suffix in BY_PATH:
            return reader(self.path)
        stream: Any = gzip.GzipFile(fileobj=self._raw) if self._zipped else self._raw
        return reader(_Lines(stream, encoding="utf-8", errors="strict") if self._suffix in TEXT else stream)


class _Lines(io.TextIOWrapper):
    """Iterates over lines; one without an end is an error and not a gigabyte of memory."""

    def __next__(self) -> str:  # type: ignore[override]  # as in TextIOWrapper, whose stub says so of IOBase itself
        line = self.readline(LONGEST_LINE + 1)
        if not line:
            raise StopIteration
        if len(line) > LONGEST_LINE:
            raise ValueError(f"a line has more than {LONGEST_LINE} characters")
        return line


def _check(message: can.Message) -> None:
    """Raises ValueError for what no reader should have accepted: SQLite and text can hold numbers that are not a time or an id."""
    if not (isinstance(message.timestamp, int | float) and abs(message.timestamp) < END_OF_TIME):
        raise ValueError(f"the next message's time is {message.timestamp!r}")
    if not isinstance(message.arbitration_id, int):
        raise ValueError(f"the next message's id is {message.arbitration_id!r}")


def _check_database(path: Path) -> None:
    """Raises ValueError unless the messages are in a plain table: a view or a computed column may never end."""
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
        kinds = [kind for (kind,) in database.execute("SELECT type FROM pragma_table_list WHERE schema = 'main' AND name = 'messages'")]
        computed = database.execute("SELECT count(*) FROM pragma_table_xinfo('messages') WHERE hidden").fetchone()
    if kinds != ["table"] or computed != (0,):
        raise ValueError("the database has no plain table 'messages'")
