"""Files of other people's data sets; whatever they lack is one sentence."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.errors import EchogridError
from echogrid.files import unread


def load_npz(path: Path, keys: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Those arrays of an .npz file, every one of them there. Raises EchogridError."""
    try:
        with path.open("rb") as file:  # numpy leaves a file open that it opened itself and could not read
            if not zipfile.is_zipfile(file):  # of another file numpy says how to run what is in it
                raise ValueError("it begins or ends otherwise")
            file.seek(0)
            archive = np.load(file, allow_pickle=False)
            missing = [key for key in keys if key not in archive]
            if missing:
                raise EchogridError(f"{path}: has no array '{missing[0]}', found {some(archive.files)}")
            return {key: archive[key] for key in keys}
    except OSError as error:
        raise EchogridError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise EchogridError(f"{path}: is not an .npz file of arrays: {error}") from error


def load_json(path: Path) -> Any:
    """Raises EchogridError."""
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise unread(path, error) from error
    except ValueError as error:
        raise EchogridError(f"{path}: is not valid JSON: {error}") from error


def load_text(path: Path) -> str:
    """Raises EchogridError."""
    try:
        return path.read_text("utf-8")
    except OSError as error:
        raise unread(path, error) from error
    except UnicodeDecodeError as error:
        raise EchogridError(f"{path}: is not a text in UTF-8: {error.reason} at byte {error.start}") from error


def field(record: Any, key: str, path: Path) -> Any:
    """`record[key]` of an object in a JSON file. Raises EchogridError."""
    if not isinstance(record, dict):
        raise EchogridError(f"{path}: found {type(record).__name__} where an object with '{key}' was expected")
    if key not in record:
        raise EchogridError(f"{path}: an object has no key '{key}', found {some(record)}")
    return record[key]


def numbers(records: Any, keys: Iterable[tuple[str, int | None]], path: Path) -> NDArray[np.float64]:
    """(N, keys) from a JSON list of objects; a key goes with a place in a list, or None for a plain number. Raises EchogridError."""
    if not isinstance(records, list) or not records:
        raise EchogridError(f"{path}: expected a list of at least one object")
    wanted = list(keys)
    try:
        rows = [[field(one, key, path) if place is None else field(one, key, path)[place] for key, place in wanted] for one in records]
        return np.array(rows, dtype=np.float64)
    except (TypeError, ValueError, IndexError) as error:
        raise EchogridError(f"{path}: expected numbers in {some(key for key, _ in wanted)}: {error}") from error


def some(names: Iterable[object], most: int = 8) -> str:
    """The first few of the names, for a sentence."""
    listed = [str(name) for name in names]
    return ", ".join(listed[:most]) + (f" and {len(listed) - most} more" if len(listed) > most else "") if listed else "nothing"
