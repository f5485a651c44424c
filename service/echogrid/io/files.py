"""Reading whole files that others wrote."""

from __future__ import annotations

from pathlib import Path

from echogrid.errors import EchogridError


def read(path: Path, most: int) -> bytes:
    """The file's bytes. Raises EchogridError where it cannot be read or holds more than `most`."""
    try:
        with path.open("rb") as file:
            data = file.read(most + 1)
    except OSError as error:
        raise EchogridError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > most:
        raise EchogridError(f"{path}: holds more than {most >> 10} KiB, which is far beyond what such a file needs")
    return data
