"""A map of another format as a store."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from echogrid.core.map.look_map import Calibration
from echogrid.core.map.tile import MOST_RADARS, Tile, TileKey
from echogrid.core.map.tiled_map import pieces
from echogrid.errors import EchogridError
from echogrid.maps.files import may_write, new_store, read_dense
from echogrid.maps.stored_epoch import OnProgress
from echogrid.store.epoch import Description
from echogrid.store.store_file import SUFFIX

AT_ONCE = 64  # tiles in one transaction
CLAMP = 3.5  # log-odds, of the maps it is merged to
NEVER = 1 << 31  # cells from the origin; no map is there


def import_map(path: Path, out: Path, *, vehicle: str = "imported", force: bool = False, on_progress: OnProgress | None = None) -> str:
    """Writes a store with one epoch of the rule `sum`; returns what was written and what the file does not say. Raises EchogridError."""
    if out.suffix != SUFFIX:
        raise EchogridError(f"{out}: expected a name that ends with {SUFFIX}")
    may_write(out, force, (path,))
    dense = read_dense(path)
    height, width = dense.log_odds.shape
    if not dense.log_odds.any():
        raise EchogridError(f"{path}: no cell of the map is known, so there is nothing to import")
    if len(dense.names) > MOST_RADARS:
        raise EchogridError(f"{path}: names: found {len(dense.names)} radars, expected at most {MOST_RADARS}")
    x, y = (along / dense.cell for along in dense.origin)
    if max(abs(x), abs(y)) > NEVER:
        raise EchogridError(f"{path}: origin: found {dense.origin[0]:g}, {dense.origin[1]:g}, expected metres near the map")
    row, column = round(y), round(x)
    oldest = 0 if dense.seen_s is None else int(dense.seen_s[dense.seen_s > 0].min(initial=np.iinfo(np.uint32).max))
    begun_ns = oldest * 10**9 if dense.seen_s is not None and dense.seen_s.any() else time.time_ns()
    what = Description(begun_ns, vehicle, dense.cell, "sum", CLAMP, Calibration(), dense.names)
    seen_s = np.zeros((height, width), np.uint32) if dense.seen_s is None else dense.seen_s
    radars = np.zeros((height, width), np.uint16) if dense.radars is None else dense.radars
    tiles: dict[TileKey, Tile] = {}
    count, everything = 0, list(pieces(row, column, height, width))
    with new_store(out) as store:
        number = store.begin(what)
        for n, (key, inside, piece) in enumerate(everything, start=1):
            if dense.log_odds[piece].any() or seen_s[piece].any():
                tile = tiles[key] = Tile.empty(1)
                tile.layers[0][inside], tile.seen_s[inside], tile.radars[inside] = dense.log_odds[piece], seen_s[piece], radars[piece]
                count += 1
            if len(tiles) == AT_ONCE or n == len(everything):
                store.write(number, tiles, int(seen_s.max()) * 10**9)
                tiles.clear()
                if on_progress is not None:
                    on_progress(n / len(everything))
    missing = ["what was measured and what learned"]
    if path.suffix != ".npz":
        missing.insert(0, "probabilities finer than the picture's")
    if dense.seen_s is None:
        missing.append("when a cell was in view")
    if dense.radars is None:
        missing.append("by which radar")
    shift = max(abs(x - column), abs(y - row)) * dense.cell
    moved = f"; moved by {shift:.3f} m, onto whole cells" if shift > 1e-6 * dense.cell else ""
    cells = f"{np.count_nonzero(dense.log_odds)} known cells of {dense.cell:g} m"
    return f"{out}: {count} tiles, {cells}{moved}; not in {path}: {', '.join(missing)}"
