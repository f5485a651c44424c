"""A stored map in other formats, or as a store of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from echogrid.core.map.map_delta import Rectangle
from echogrid.core.map.tile import SIDE, Tile, TileKey
from echogrid.errors import EchogridError
from echogrid.maps import map_server
from echogrid.maps.dense_map import MOST_CELLS, Bands, write_npz
from echogrid.maps.files import may_write, new_store, open_store
from echogrid.maps.picture import save, shade
from echogrid.maps.stored_epoch import OnProgress, StoredEpoch, part
from echogrid.store.store_file import SUFFIX

FORMATS = {"ros": ".yaml", "png": ".png", "npz": ".npz", "egmap": SUFFIX}
AT_ONCE = 64  # tiles that are in memory
T = TypeVar("T", bound=np.generic)
Box = tuple[float, float, float, float]  # x0, y0, x1, y1 in m


def export(
    path: Path,
    out: Path,
    *,
    epoch: int | None = None,
    form: str | None = None,
    mode: str | None = None,
    box: Box | None = None,
    force: bool = False,
    on_progress: OnProgress | None = None,
) -> str:
    """Writes an epoch (None: the newest); returns a sentence on what was written and what is not in it.

    `form`: one of FORMATS; None: by the suffix of `out`. `mode`: of map_server; None: trinary. Raises EchogridError.
    """
    form = form or next((name for name, suffix in FORMATS.items() if out.suffix == suffix), None)
    if form is None:
        raise EchogridError(f"{out}: no format has its suffix: expected one of {', '.join(FORMATS.values())}, or --format")
    if form == "ros" and out.suffix != ".yaml":
        raise EchogridError(f"{out}: name a map_server map by its .yaml; the picture is written beside it")
    if form != "ros" and mode is not None:
        raise EchogridError(f"{out}: --mode {mode} is for map_server maps, not for {form}")
    mode = mode or "trinary"
    for output in (out, map_server.picture_path(out, mode)) if form == "ros" else (out,):
        may_write(output, force, (path,))
    with open_store(path) as store:
        stored = StoredEpoch(store, epoch)
        cells = None if box is None else box_cells(box, stored.description.cell)
        if form == "egmap":
            return _export_tiles(stored, cells, out, on_progress)
        where = _rectangle(stored, cells, part(on_progress, 0, 2))
        writing = part(on_progress, 1, 2)
        if form == "npz":
            _export_npz(stored, where, out, writing)
            lost = "the layers that its log-odds are computed from"
        elif form == "png":
            _export_png(stored, where, out, writing)
            lost = "its position, when a cell was in view and by which radar"
        else:
            _export_map_server(stored, where, out, mode, writing)
            finer = "how sure a cell is" if mode == "trinary" else "what is finer than a percent"
            lost = f"{finer}, when a cell was in view and by which radar"
    return f"{out}: {where.width} x {where.height} cells of {stored.description.cell:g} m; not in it: {lost}"


def parse_box(text: str) -> Box:
    """`X0,Y0,X1,Y1` in m. Raises EchogridError."""
    try:
        x0, y0, x1, y1 = map(float, text.split(","))
    except ValueError:
        x0 = y0 = x1 = y1 = math.nan
    if not (x0 < x1 and y0 < y1 and math.isfinite(x1 - x0) and math.isfinite(y1 - y0)):
        raise EchogridError(f"--bbox: found '{text}', expected X0,Y0,X1,Y1 in m with X0 < X1 and Y0 < Y1")
    return x0, y0, x1, y1


def box_cells(box: Box, cell: float) -> Rectangle:
    """The cells that a rectangle (m) touches."""
    x0, y0, x1, y1 = box
    column, row = math.floor(x0 / cell), math.floor(y0 / cell)
    return Rectangle(row, column, math.ceil(y1 / cell) - row, math.ceil(x1 / cell) - column)


def _rectangle(stored: StoredEpoch, cells: Rectangle | None, on_progress: OnProgress | None) -> Rectangle:
    """The cells to write: those requested, or all that are known. Raises EchogridError if there are none or too many."""
    name, cell = f"{stored.store.path}: epoch {stored.number}", stored.description.cell
    where = stored.extent(on_progress).known if cells is None else cells
    if not where.height * where.width:
        raise EchogridError(f"{name}: no cell is known, so there is nothing to export")
    if not any(_touches(key, where) for key in stored.keys):
        raise EchogridError(f"{name}: there is no tile of it in --bbox, so there is nothing to export")
    if where.height * where.width > MOST_CELLS:
        raise EchogridError(
            f"{name}: {where.width} x {where.height} cells ({where.width * cell / 1e3:.1f} x {where.height * cell / 1e3:.1f} km) are more"
            f" than the {MOST_CELLS >> 20} Mi that one dense map may have: cut it with a smaller --bbox x0,y0,x1,y1, or export to {SUFFIX}"
        )
    return where


def _export_npz(stored: StoredEpoch, where: Rectangle, out: Path, on_progress: OnProgress | None) -> None:
    cell = stored.description.cell

    def bands(n: int, plane: Callable[[Tile], NDArray[T]], dtype: type[T]) -> Bands:
        return Bands((where.height, where.width), np.dtype(dtype), stored.bands(where, plane, dtype, part(on_progress, n, 4)))

    arrays: dict[str, NDArray[Any] | Bands] = {
        "log_odds": bands(0, stored.log_odds, np.float32),
        "seen_s": bands(1, lambda tile: tile.seen_s, np.uint32),
        "radars": bands(2, lambda tile: tile.radars, np.uint16),
        "measured": bands(3, stored.measured, np.bool_),
        "origin": np.array((where.column * cell, where.row * cell)),
        "cell": np.array(cell),
        "names": np.array(stored.description.radars, dtype=np.str_),
    }
    write_npz(out, arrays)


def _export_png(stored: StoredEpoch, where: Rectangle, out: Path, on_progress: OnProgress | None) -> None:
    colours = np.empty((where.height, where.width, 3), dtype=np.uint8)
    last = where.height
    for band in stored.bands(where, stored.log_odds, np.float32, on_progress):
        colours[last - len(band) : last] = shade(band)[::-1]
        last -= len(band)
    save(Image.fromarray(colours), out)


def _export_map_server(stored: StoredEpoch, where: Rectangle, out: Path, mode: str, on_progress: OnProgress | None) -> None:
    cell = stored.description.cell
    pixels = np.empty((where.height, where.width, *((4,) if mode == "scale" else ())), dtype=np.uint8)
    last = where.height
    for band in stored.bands(where, stored.log_odds, np.float32, on_progress):
        pixels[last - len(band) : last] = map_server.pixels_of(band, mode)
        last -= len(band)
    map_server.write(out, pixels, (where.column * cell, where.row * cell), cell, mode)


def _export_tiles(stored: StoredEpoch, cells: Rectangle | None, out: Path, on_progress: OnProgress | None) -> str:
    """As they are, under the epoch's own number; of a rectangle all tiles that it touches."""
    keys = stored.keys if cells is None else [key for key in stored.keys if _touches(key, cells)]
    if not keys:
        raise EchogridError(f"{stored.store.path}: epoch {stored.number}: there is no tile to export")
    with new_store(out) as store:
        store.begin(stored.description, stored.number)
        for first in range(0, len(keys), AT_ONCE):
            by_stamp: dict[int, dict[TileKey, Tile]] = {}
            for key in keys[first : first + AT_ONCE]:
                tile, stamp_ns = stored.tile(key), stored.store.stamp_ns(stored.number, key)
                if tile is not None and stamp_ns is not None:
                    by_stamp.setdefault(stamp_ns, {})[key] = tile
            for stamp_ns, tiles in by_stamp.items():
                store.write(stored.number, tiles, stamp_ns)
            if on_progress is not None:
                on_progress(min(1.0, (first + AT_ONCE) / len(keys)))
    return f"{out}: {len(keys)} tiles of epoch {stored.number}, unchanged"


def _touches(key: TileKey, cells: Rectangle) -> bool:
    row, column = SIDE * key[0], SIDE * key[1]
    return -SIDE < row - cells.row < cells.height and -SIDE < column - cells.column < cells.width
