"""A map of any format, small enough to look at."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from echogrid.core.map.tiled_map import LogOdds
from echogrid.errors import EchogridError
from echogrid.maps.files import may_write, open_store, read_dense
from echogrid.maps.picture import LONGEST, draw, save, shrink
from echogrid.maps.stored_epoch import OnProgress, StoredEpoch
from echogrid.store.store_file import SUFFIX


def show(
    path: Path, *, epoch: int | None = None, out: Path | None = None, force: bool = False, on_progress: OnProgress | None = None
) -> LogOdds:
    """Log-odds (H, W), at most LONGEST cells along a side; `out` takes them as a picture with a scale. `epoch`: None is the newest.

    Raises EchogridError.
    """
    if out is not None:
        if out.suffix.lower() != ".png":
            raise EchogridError(f"{out}: is not written, expected a name that ends in .png")
        may_write(out, force, (path,))
    if path.suffix == SUFFIX:
        with open_store(path) as store:
            stored = StoredEpoch(store, epoch)
            where, step, seen = stored.overview(LONGEST, on_progress)
        cell = stored.description.cell
        x, y = where.column * cell, where.row * cell
    else:
        dense = read_dense(path)
        if epoch is not None:
            raise EchogridError(f"{path}: has no epochs, and --epoch {epoch} is given")
        step = -(-max(*dense.log_odds.shape, 1) // LONGEST)
        seen, (x, y), cell = shrink(dense.log_odds, step), dense.origin, dense.cell
    if not seen.any():
        raise EchogridError(f"{path}: no cell of the map is known, so there is nothing to show")
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    top, left = int(rows[0]), int(columns[0])
    seen = seen[top : rows[-1] + 1, left : columns[-1] + 1]
    if out is not None:
        save(draw(seen, (x + left * step * cell, y + top * step * cell), step * cell, np.zeros((0, 2))), out)
    return seen
