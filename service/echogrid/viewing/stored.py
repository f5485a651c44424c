"""A stored map as a scene: nothing moves in it, but its cells can be told by their age."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from echogrid.core.map.tile import SIDE
from echogrid.errors import EchogridError
from echogrid.maps.files import open_store, read_dense
from echogrid.maps.stored_epoch import StoredEpoch
from echogrid.store.store_file import SUFFIX
from echogrid.topics.announcer import occupancy_percent
from echogrid.viewing.recorded import origin_of
from echogrid.viewing.scene import Scene
from echogrid.viewing.wire import Plane

MOST_CELLS = 1 << 24  # that a page is given
SUFFIXES = (SUFFIX, ".npz", ".yaml", ".yml")


def stored_scene(path: Path, epoch: int | None) -> Scene:
    """All of a map. `epoch` of a store: None is the newest. Raises EchogridError for a file that is none, or too large."""
    return _of_store(path, epoch) if path.suffix == SUFFIX else _of_file(path, epoch)


def _of_store(path: Path, epoch: int | None) -> Scene:
    with open_store(path) as store:
        stored = StoredEpoch(store, epoch)
        if len(stored.keys) * SIDE * SIDE > MOST_CELLS:
            what = f"epoch {stored.number} has {len(stored.keys)} tiles, expected at most {MOST_CELLS // SIDE**2}"
            raise EchogridError(f"{path}: {what}: cut a part out with `echogrid map export --bbox`")
        scene = _scene(
            path, ["OCCUPANCY", "SOURCE", "SEEN"], stored.description.cell, vehicle=stored.description.vehicle, epoch=stored.number
        )
        for (row, column), tile in stored.tiles():
            log_odds = stored.log_odds(tile)
            where = row * SIDE, column * SIDE
            scene.cells(Plane.OCCUPANCY, *where, occupancy_percent(log_odds))
            scene.cells(Plane.SOURCE, *where, origin_of(log_odds, stored.measured(tile)))
            scene.cells(Plane.SEEN, *where, tile.seen_s)
    return scene


def _of_file(path: Path, epoch: int | None) -> Scene:
    dense = read_dense(path)
    if epoch is not None:
        raise EchogridError(f"{path}: has no epochs, and --epoch {epoch} is given")
    if dense.log_odds.size > MOST_CELLS:
        raise EchogridError(f"{path}: has {dense.log_odds.size} cells, expected at most {MOST_CELLS}")
    scene = _scene(path, ["OCCUPANCY"] + (["SEEN"] if dense.seen_s is not None else []), dense.cell)
    where = round(dense.origin[1] / dense.cell), round(dense.origin[0] / dense.cell)
    scene.cells(Plane.OCCUPANCY, *where, occupancy_percent(dense.log_odds))
    if dense.seen_s is not None:
        scene.cells(Plane.SEEN, *where, np.asarray(dense.seen_s))
    return scene


def _scene(path: Path, planes: list[str], cell: float, **more: Any) -> Scene:
    scene = Scene({"shown": "map", "name": path.name, "planes": planes, "timeline": False, **more})
    scene.cell = cell
    return scene
