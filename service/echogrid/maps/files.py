"""Files that these commands read and write."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from echogrid.errors import EchogridError
from echogrid.files import no_file, whole
from echogrid.maps import map_server
from echogrid.maps.dense_map import DenseMap, read_npz
from echogrid.store.store_file import SUFFIX, ForeignFileError, StoreError
from echogrid.store.tile_store import TileStore


def open_store(path: Path) -> TileStore:
    """To be read, while a service writes it too. Raises EchogridError."""
    if not path.is_file():
        raise no_file(path, f"*{SUFFIX}")
    if not os.access(path, os.R_OK):
        raise EchogridError(f"{path}: cannot be read: {os.strerror(errno.EACCES)}")  # SQLite does not say why
    try:
        return TileStore(path)
    except ForeignFileError as error:
        if path.suffix in (".npz", *map_server.SUFFIXES):
            raise EchogridError(f"{path}: is no store, expected a {SUFFIX} file: `echogrid map import` makes one of it") from error
        raise


@contextmanager
def new_store(path: Path) -> Iterator[TileStore]:
    """A store that has its name only once all is in it; what goes wrong is said of that name."""
    with whole(path) as partial:
        try:
            with TileStore(partial, write=True) as store:
                yield store
                store.seal()
        except StoreError as error:
            raise StoreError(str(error).replace(str(partial), str(path)), error.state) from error


def read_dense(path: Path) -> DenseMap:
    """A map in another format, by the file's suffix. Raises EchogridError."""
    if not path.is_file():
        raise no_file(path, f"*{SUFFIX}", "*.yaml", "*.npz")
    if path.suffix == ".npz":
        return read_npz(path)
    if path.suffix in map_server.SUFFIXES:
        return map_server.read(path)
    if path.suffix == SUFFIX:
        raise EchogridError(f"{path}: is a store already, expected .npz, or the .yaml of a map_server map")
    raise EchogridError(f"{path}: no map format has its suffix: expected {SUFFIX}, .npz, or the .yaml of a map_server map")


def may_write(out: Path, force: bool, inputs: Sequence[Path] = ()) -> None:
    """Raises EchogridError for an output that exists already, is one of the inputs, or whose folder does not exist."""
    if not out.parent.is_dir():
        raise EchogridError(f"{out}: there is no folder {out.parent}")
    if not out.exists():
        return
    if any(path.exists() and path.samefile(out) for path in inputs):
        raise EchogridError(f"{out}: would be read and written at once: name another output")
    if not force:
        raise EchogridError(f"{out}: exists already: name another output, or give --force to replace it")
    if out.suffix == SUFFIX:
        _settle(out)


def _settle(path: Path) -> None:
    """A store that will be replaced: without a -wal file, which SQLite would apply to the new one, and not open anywhere."""
    try:
        with TileStore(path, write=True) as store:
            store.seal()
    except ForeignFileError:
        return
    except StoreError as error:
        raise EchogridError(f"{error}: it was not replaced, name another output") from error
