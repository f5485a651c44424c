"""Recordings of CAN traffic, by the file's ending."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import can

from echogrid.can.intake.frames import FrameBatch, batches
from echogrid.errors import EchogridError
from echogrid.files import meant, surely, unread
from echogrid.logs.drive import first_recording
from echogrid.logs.formats import blf, library, pcap
from echogrid.logs.formats.account import Account
from echogrid.logs.formats.kind import FIRST, hint
from echogrid.logs.formats.stream import Stream
from echogrid.logs.formats.times import Times, settled
from echogrid.logs.text import asc, candump, csv_log, trc

Reader = Callable[[Stream, Account], Iterator[FrameBatch]]
OURS: dict[str, Reader] = {
    ".asc": asc.read,
    ".blf": blf.read,
    ".csv": csv_log.read,
    ".log": candump.read,
    ".pcap": pcap.read,
    ".pcapng": pcap.read,
    ".trc": trc.read,
}
HEADLESS = (".log", ".csv")  # formats that cannot say what their times are
BY_PATH = {".db": library.read_sqlite, ".mf4": library.read_mf4}
PACKED = (".gz", ".zst")
MOST_UNPACKED = 16 << 30  # bytes of a packed file that a library reads from disk
EXTRAS = {  # what reads an ending, where it is not installed with the service
    ".mf4": "the package asammdf: pip install asammdf",
    ".mcap": "the package mcap: pip install mcap",
}


class Log:
    """The frames of a recording, in the file's order. `messages` counts them.

    `progress` is the share of the file whose frames were taken, 0 to 1. `account` and `times` say what was in it, complete at the end.
    Raises EchogridError at once for an unknown ending or a missing file, and after the last message that could be read where anything was
    not understood or torn.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.messages = 0
        self._taken = 0  # bytes of the file
        self.account = Account()
        self.times = Times()
        suffixes = [suffix.lower() for suffix in path.suffixes]
        self._packing = suffixes.pop() if suffixes and suffixes[-1] in PACKED else ""
        self._suffix = suffixes[-1] if suffixes else ""
        known = (*OURS, *BY_PATH, ".mcap")
        if surely(path.is_dir):
            raise EchogridError(f"{path}: is a folder, expected a recording, such as {first_recording(path) or path / 'can.log'}")
        if self._suffix not in known and not surely(path.exists) and (near := meant(path)):
            raise EchogridError(f"{path}: there is no such file{near}")
        if self._suffix not in known:
            raise EchogridError(
                f"{path}: is not a known log format, expected one of {' '.join(sorted(known))}, each also with {' or '.join(PACKED)}"
            )
        self._size = 0
        if not surely(path.is_fifo):  # through a pipe all comes once, and no one knows how much
            with self._opened() as file:
                self._size = os.fstat(file.fileno()).st_size
        self._ended = False

    @property
    def progress(self) -> float:
        return 1.0 if self._ended or not self._size else self._taken / self._size

    def __iter__(self) -> Iterator[can.Message]:
        """One by one."""
        for batch in self.batches():
            yield from batch

    def batches(self) -> Iterator[FrameBatch]:
        """Many at once; none is empty."""
        try:
            with self._opened() as raw:
                for batch in self._batches(raw):
                    self.times.add(batch.stamps)
                    self.messages += len(batch)
                    if len(batch):
                        yield batch
                    self._taken = raw.tell() if self._size else 0
        except (EchogridError, GeneratorExit):
            raise
        except ImportError as error:
            needed = EXTRAS.get(self._suffix, str(error))
            raise EchogridError(f"{self.path}: reading {self._suffix} files needs {needed}") from error
        except Exception as error:  # libraries raise whatever garbage makes them stumble over
            what = str(error) if type(error) is ValueError else f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
            raise EchogridError(f"{self.path}: cannot be read beyond message {self.messages}: {what}{self._hint()}") from error
        finally:
            self._ended = True
        faults = self.account.faults(self.messages)
        if not self.messages:
            faults.insert(0, "holds no CAN message")
        if faults:
            raise EchogridError(f"{self.path}: {'; '.join(faults)}{self._hint()}")

    def _hint(self) -> str:
        """What else a file without a frame may be, as the end of a sentence."""
        if not self._size and not self.path.is_fifo():
            return "; the file is empty"
        if self.messages or not self._size:
            return ""
        with self._opened() as file:
            return hint(file.read(FIRST), self._suffix, self._packing)

    def _opened(self) -> BinaryIO:
        try:
            return self.path.open("rb")
        except OSError as error:
            raise unread(self.path, error) from error

    def _batches(self, raw: BinaryIO) -> Iterator[FrameBatch]:
        if self._suffix in BY_PATH:
            yield from self._by_path(raw)
            return
        stream = Stream(raw, self._packing, self.account)
        if self._suffix == ".mcap":
            from echogrid.logs.formats.mcap_log import McapLog  # an extra

            yield from batches(library.checked(iter(McapLog(stream.file())), self.account))
            return
        found = OURS[self._suffix](stream, self.account)
        yield from settled(found, self.account) if self._suffix in HEADLESS else found

    def _by_path(self, raw: BinaryIO) -> Iterator[FrameBatch]:
        if not self._packing:
            yield from BY_PATH[self._suffix](self.path, self.account)
            return
        with tempfile.TemporaryDirectory(prefix="echogrid-") as folder:
            path = Path(folder) / f"unpacked{self._suffix}"
            stream = Stream(raw, self._packing, self.account)
            with path.open("wb") as file:
                for chunk in stream.chunks():
                    if stream.length > min(MOST_UNPACKED, shutil.disk_usage(folder).free):
                        raise ValueError(f"it unpacks to more than {stream.length >> 20} MiB, for which there is no room")
                    file.write(chunk)
            yield from BY_PATH[self._suffix](path, self.account)


def check_rereadable(path: Path) -> None:
    """Before a recording is read more than once. Raises EchogridError for a pipe, whose second reader would wait for ever."""
    if surely(path.is_fifo):
        raise EchogridError(f"{path}: is a pipe, which can be read once, expected a file: this reads it twice")
