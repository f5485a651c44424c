"""A map as one rectangle of cells, and its npz file."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map.tiled_map import LogOdds
from echogrid.errors import EchogridError
from echogrid.files import whole

MOST_CELLS = 1 << 26  # of a rectangle: 64 Mi, a square of 1.9 km at the default cell
WRITTEN = (1980, 1, 1, 0, 0, 0)  # a zip holds times of writing; the same map is the same file


@dataclass(frozen=True, slots=True, eq=False)
class DenseMap:
    """Log-odds (H, W), 0 unknown; `origin` is the corner (x, y) of cell [0, 0] in m, `cell` a cell's side in m.

    `seen_s` (H, W) are Unix seconds, `radars` (H, W) one bit for each of `names`; both are None if a file does not say.
    """

    log_odds: LogOdds
    origin: tuple[float, float]
    cell: float
    seen_s: NDArray[np.uint32] | None = None
    radars: NDArray[np.uint16] | None = None
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """An array that is too large to be held: its shape, its type, and bands of its rows, in order."""

    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]
    bands: Iterable[NDArray[np.generic]]


def write_npz(path: Path, arrays: Mapping[str, NDArray[np.generic] | Bands]) -> None:
    """Writes arrays for numpy.load: the file is complete and on disk when it returns, or not there. Raises OSError."""
    with whole(path) as partial, zipfile.ZipFile(partial, "w") as packed:
        for name, array in arrays.items():
            bands = array if isinstance(array, Bands) else Bands(array.shape, array.dtype, (array,))
            entry = zipfile.ZipInfo(f"{name}.npy", WRITTEN)
            entry.compress_type = zipfile.ZIP_DEFLATED
            with packed.open(entry, "w", force_zip64=True) as file:
                header = {"descr": np.lib.format.dtype_to_descr(bands.dtype), "fortran_order": False, "shape": bands.shape}
                np.lib.format.write_array_header_1_0(file, header)
                for band in bands.bands:
                    file.write(np.ascontiguousarray(band).data)


def read_npz(path: Path) -> DenseMap:
    """What `write_npz` wrote of a map: log_odds, origin, cell, and seen_s, radars and names where they are there.

    Raises EchogridError for a file that is something else, or holds more than MOST_CELLS.
    """
    try:
        with zipfile.ZipFile(path) as packed:
            most = max((entry.file_size for entry in packed.infolist()), default=0)
        if most > 4 * MOST_CELLS + 128:
            raise ValueError(f"an array unpacks to {most >> 20} MiB, expected at most {MOST_CELLS >> 20} Mi cells")
        with np.load(path, allow_pickle=False) as file:
            log_odds, (x, y), cell = file["log_odds"].astype(np.float32), map(float, file["origin"]), float(file["cell"])
            seen_s = file["seen_s"].astype(np.uint32) if "seen_s" in file else None
            radars = file["radars"].astype(np.uint16) if "radars" in file else None
            names = tuple(map(str, file["names"])) if "names" in file else ()
        if log_odds.ndim != 2 or any(plane is not None and plane.shape != log_odds.shape for plane in (seen_s, radars)):
            raise ValueError("the planes do not have one shape")
        if not (np.isfinite([x, y, cell]).all() and cell > 0 and np.isfinite(log_odds).all()):
            raise ValueError("not all numbers are finite")
        if radars is not None and int(radars.max(initial=0)) >> len(names):
            raise ValueError(f"radars has bits beyond the {len(names)} names")
    except Exception as error:  # zipfile, zlib and numpy raise what garbage makes them stumble over
        raise EchogridError(f"{path}: is not a map with the arrays log_odds, origin and cell: {error}") from error
    return DenseMap(log_odds, (x, y), cell, seen_s, radars, names)
