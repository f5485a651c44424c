"""Recordings of CAN traffic: every format that python-can reads, by the file's ending."""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
from can.io.player import MESSAGE_READERS

from echogrid.errors import EchogridError

TEXT, BINARY, BY_PATH = (".asc", ".csv", ".log", ".trc"), (".blf",), (".db", ".mf4")


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
        if self._suffix not in MESSAGE_READERS or (self._zipped and self._suffix in BY_PATH):
            expected = " ".join((*TEXT, *BINARY, *BY_PATH))
            raise EchogridError(f"{path}: is no log format that is known, expected one of {expected} (text and .blf also with .gz)")
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
                for message in self._reader():
                    self.messages += 1
                    yield message
        except (EchogridError, GeneratorExit):
            raise
        except ImportError as error:
            raise EchogridError(f"{self.path}: reading {self._suffix} files needs the package asammdf ({error})") from error
        except Exception as error:  # python-can's readers raise whatever garbage makes them stumble over
            what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            raise EchogridError(f"{self.path}: cannot be read beyond message {self.messages}: {what}") from error
        if not self.messages:
            raise EchogridError(f"{self.path}: holds no CAN message")

    def _reader(self) -> Any:
        reader: Any = MESSAGE_READERS[self._suffix]
        if self._suffix in BY_PATH:
            return reader(self.path)
        stream: Any = gzip.GzipFile(fileobj=self._raw) if self._zipped else self._raw
        return reader(io.TextIOWrapper(stream, encoding="utf-8", errors="strict") if self._suffix in TEXT else stream)
