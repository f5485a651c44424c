"""Reading whole files from others, and writing whole files."""

from __future__ import annotations

import difflib
import errno
import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import BinaryIO

from echogrid.errors import EchogridError

NEAR = 0.85  # of all letters in common: that both end in .toml is not enough
MOST_NAMES = 1000  # of a folder, among which a name is looked for


def meant(path: Path) -> str:
    """The end of a sentence about a file that is not there: a name beside it that is nearly the same, or nothing."""
    try:
        names = [entry.name for entry, _ in zip(path.parent.iterdir(), range(MOST_NAMES), strict=False) if entry.name != path.name]
    except OSError:
        return ""
    near = difflib.get_close_matches(path.name, names, n=1, cutoff=NEAR)
    return f"; did you mean {path.with_name(near[0])}?" if near else ""


def surely(asked: Callable[[], bool]) -> bool:
    """What a path's `is_file` and the like say; False where they raise, of a name that is too long or in a folder that is closed to us."""
    try:
        return asked()
    except OSError:
        return False


def never(path: Path) -> str | None:
    """Why no file or folder can have that name, now or later; None where one can."""
    try:
        path.stat()
    except OSError as error:
        return error.strerror if error.errno == errno.ENAMETOOLONG else None
    return None


def no_file(path: Path, *names: str) -> EchogridError:
    """What to say of a path that is none; `names`: patterns of files that a folder may hold in its place."""
    if not surely(path.is_dir):
        return EchogridError(
            f"{path}: is a device or a pipe, expected a file" if surely(path.exists) else f"{path}: there is no such file{meant(path)}"
        )
    held = next((found for name in names for found in sorted(path.glob(name))), None)
    return EchogridError(f"{path}: is a folder, expected a file" + (f" such as {held}" if held else ""))


def read(path: Path, most: int) -> bytes:
    """The file's bytes. Raises EchogridError where it cannot be read or holds more than `most`."""
    try:
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        if surely(path.is_dir):
            raise no_file(path, f"*{path.suffix or '.toml'}") from error
        raise unread(path, error) from error
    if len(data) > most:
        raise EchogridError(f"{path}: holds more than {most >> 10} KiB, which is far beyond what such a file needs")
    return data


def unread(path: Path, error: OSError) -> EchogridError:
    """What to say of a file that could not be opened."""
    return EchogridError(f"{path}: cannot be read: {error.strerror}{'' if surely(path.exists) else meant(path)}")


def check_folder(path: Path) -> None:
    """Before work whose results go there: it is a folder that can be written, or can be made. Raises EchogridError."""
    if (why := never(path)) is not None:
        raise EchogridError(f"{path}: cannot be made: {why}")
    there = next(one for one in (path, *path.absolute().parents) if os.path.lexists(one))
    if not there.is_dir():
        raise EchogridError(f"{path}: is a file, expected a folder" if there == path else f"{path}: cannot be made: {there} is a file")
    _check_writable(path, there)


def check_file(path: Path, suffix: str = "") -> None:
    """The same of a file in a folder that is there; `suffix`: what its name ends in, so that it is no recording. Raises EchogridError."""
    if not path.name.lower().endswith(suffix):
        raise EchogridError(f"{path}: is not written, expected a name that ends in {suffix}")
    if path.is_dir():
        raise EchogridError(f"{path}: is a folder, expected the name of a file")
    if not path.absolute().parent.is_dir():
        raise EchogridError(f"{path}: there is no folder {path.parent}")
    _check_writable(path, path if path.exists() else path.absolute().parent)


def _check_writable(path: Path, there: Path) -> None:
    if not os.access(there, os.W_OK | os.X_OK if there.is_dir() else os.W_OK):
        raise EchogridError(f"{path}: cannot be written: {there} is closed to this user, or on a disk that is read-only")


def sentence(error: OSError) -> str:
    """What is said of an error of the operating system, which names no file where one was being written."""
    return f"{error.filename or 'the operating system says'}: {error.strerror or error}"


@contextmanager
def named(path: Path) -> Iterator[None]:
    """An error of the operating system that names no file, as those of writing do not, is said of `path`."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(path)
        raise


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Another name beside `path` to write to: at the end what is there is on the disk under `path`, or, where it failed, nowhere.

    Programs that write the same file at one time do not meet: the last that ends is there, whole.
    """
    try:
        partial, held = _claimed(path)
        with held:
            try:
                yield partial
                with partial.open("rb") as file:
                    os.fsync(file.fileno())
                partial.replace(path)
            except BaseException:
                for left in ("", "-wal", "-shm"):  # and what SQLite keeps beside a file that it could not close
                    with suppress(OSError):  # on a disk that takes nothing there is none either
                        partial.with_name(partial.name + left).unlink(missing_ok=True)
                raise
    except OSError as error:
        ours = error.filename is None or str(error.filename).startswith(str(_partial(path)))
        error.filename = str(path) if ours else error.filename
        raise


def _partial(path: Path, number: str = "") -> Path:
    return path.with_name(f".{path.name}.partial{number}")


def _claimed(path: Path) -> tuple[Path, BinaryIO]:
    """An empty file beside `path` that no other program writes, under a name that one which was killed may have left, and what holds it."""
    for number in count():
        partial = _partial(path, str(number or ""))
        held = partial.open("ab")
        with suppress(FileNotFoundError):  # another program ended just now
            if _locked(held) and os.path.samestat(os.fstat(held.fileno()), partial.stat()):
                held.truncate(0)
                return partial, held
        held.close()
    raise AssertionError("there is always one more number")


def _locked(file: BinaryIO) -> bool:
    """Whether nobody else has locked the file; we have now, until it is closed, where the file system knows locks."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True
