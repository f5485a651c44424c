"""A map as a small picture: the same from every format, and no obstacle is lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.support.stores import described, random_tiles, window, write_store

from echogrid.maps import map_server
from echogrid.maps import show as showing
from echogrid.maps.export import export
from echogrid.maps.picture import text
from echogrid.maps.show import show
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore


def test_every_format_shows_the_same_map(stored: Path, tmp_path: Path) -> None:
    """As the terminal's text of all cells; a picture with a scale beside it."""
    log_odds, _ = window(stored, 1)
    expected = text(log_odds, 100)
    export(stored, tmp_path / "map.npz", epoch=1)
    export(stored, tmp_path / "map.yaml", epoch=1, mode="scale")
    rounded = text(map_server.read(tmp_path / "map.yaml").log_odds, 100)
    for path, epoch, whole in ((stored, 1, expected), (tmp_path / "map.npz", None, expected), (tmp_path / "map.yaml", None, rounded)):
        assert text(show(path, epoch=epoch, out=tmp_path / f"{path.name}.png"), 100) == whole
        with Image.open(tmp_path / f"{path.name}.png") as picture:
            assert picture.width >= log_odds.shape[1]
    assert expected.count("255") > 100


def test_a_wide_map_shows_small_all_that_is_occupied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One cell for part of a tile, for a whole one, for several: occupied where any of its cells is, else free where any is."""
    monkeypatch.setattr(showing, "LONGEST", 20)
    for far, step in ((9, 64), (15, 128), (40, 512)):
        keys = ((0, 0), (1, 2), (far // 5, far))
        path = write_store(tmp_path / f"{far}.egmap", random_tiles(far, keys, "sum"), described("sum"))
        with TileStore(path) as store:
            occupancy = stored_map(store, 1)
            whole = occupancy.window(*occupancy.bounds())
        whole = np.pad(whole, [(0, -length % step) for length in whole.shape])
        blocks = whole.reshape(len(whole) // step, step, -1, step)
        occupied, free = blocks.max(axis=(1, 3)) > 1, blocks.min(axis=(1, 3)) < 0
        seen = show(path)
        assert max(seen.shape) <= 20
        np.testing.assert_array_equal(
            np.pad(seen, [(0, all_ - ours) for all_, ours in zip(occupied.shape, seen.shape, strict=True)]) > 1, occupied
        )
        assert (seen < 0).sum() == (free & ~occupied).sum()
