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
    """A lock of the kernel's on a store's file, which ends with the process, or with `close`: none is left behind by one that was killed.

    Who closes it has closed its connections to the file before: SQLite's own locks go with any descriptor that is closed.
    """

    def __init__(self, path: Path) -> None:
        """Raises HeldError naming who has it, and OSError where the file cannot be opened. A file system without locks gives it to all."""
        self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # a pipe is not waited for
        self.inode = os.fstat(self._file).st_ino
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.close()
            raise HeldError(f"{path}: is being written by {_holder(self.inode)}: wait for its end, or name another file") from None
        except OSError:
            pass

    def close(self) -> None:
        """Once."""
        os.close(self._file)


def claimed(path: Path) -> Claim | None:
    """None where there is no file yet, or none that can be opened. Raises HeldError."""
    try:
        return Claim(path)
    except OSError:
        return None


def check_free(path: Path) -> None:
    """Raises HeldError where another process writes it. Not for a file to which this process has connections."""
    claim = claimed(path)
    if claim is not None:
        claim.close()


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
