"""Who may write a store: one process at a time, from its first look to its end, however that comes."""

from __future__ import annotations

import fcntl
import os
from contextlib import suppress
from pathlib import Path

from echogrid.store.store_file import StoreError

LONGEST = 120  # characters that are said of a command


class HeldError(StoreError):
    """A store that another process writes."""


class Claim:
    """Remembers the file that it holds: by a lock of the kernel's, which ends with the process, however that ends, or with `release`.

    Who releases it has closed its connections to the file before: SQLite's own locks go with any descriptor that is closed.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None

    def hold(self) -> None:
        """The file that is there now, and no more one that was there before; nothing where there is none that can be opened. A file system
        without locks gives it to all. Raises HeldError naming who has it."""
        if self._file is not None and self._is_there(self._file):
            return
        self.release()
        with suppress(OSError):
            self._file = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe is not waited for
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                holder = _holder(os.fstat(self._file).st_ino)
                self.release()
                raise HeldError(f"{self._path}: is being written by {holder}: wait for its end, or name another file") from None

    def release(self) -> None:
        """A second time does nothing."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _is_there(self, file: int) -> bool:
        try:
            return os.path.samestat(os.fstat(file), self._path.stat())
        except OSError:
            return False


def check_free(path: Path) -> None:
    """Raises HeldError where another process writes it. Not for a file to which this process has connections."""
    claim = Claim(path)
    claim.hold()
    claim.release()


def _holder(inode: int) -> str:
    """The process with the lock, and its command, as far as the kernel tells us."""
    with suppress(OSError):  # no /proc
        for line in Path("/proc/locks").read_text().splitlines():  # 1: FLOCK  ADVISORY  WRITE 812 08:01:4711 0 EOF
            words = line.split()
            if words[1] == "FLOCK" and words[5].rpartition(":")[2] == str(inode):
                return f"process {words[4]}{_command(words[4])}"
    return "another process"


def _command(process: str) -> str:
    """What was typed, from the program's name on."""
    with suppress(OSError):
        words = Path(f"/proc/{process}/cmdline").read_text(errors="replace").rstrip("\0").split("\0")
        first = next((n for n, word in enumerate(words) if Path(word).name == "echogrid"), 0)
        typed = " ".join([Path(words[first]).name, *words[first + 1 :]])
        return f" ({typed[:LONGEST]}{'…' * (len(typed) > LONGEST)})" if typed else ""
    return ""
