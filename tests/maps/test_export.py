"""A stored map in other formats, and back: what comes out is what is in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.support.stores import CELL, NAMES, content, random_tiles, window, write_store

from echogrid.errors import EchogridError
from echogrid.maps import map_server
from echogrid.maps.dense_map import MOST_CELLS, read_npz
from echogrid.maps.export import export, parse_box
from echogrid.maps.importing import import_map
from echogrid.maps.picture import shade
from echogrid.maps.show import show
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


def test_an_epoch_as_a_store_of_its_own_is_the_same_bits(stored: Path, tmp_path: Path) -> None:
    for epoch in (1, 3):
        out = tmp_path / f"{epoch}.egmap"
        assert export(stored, out, epoch=epoch).startswith(f"{out}: 3 tiles of epoch {epoch}, unchanged")
        assert content(out) == content(stored, epoch)
        with TileStore(out) as one, TileStore(stored) as other:
            assert [found.id for found in one.epochs()] == [epoch]
            assert [one.stamp_ns(epoch, key) for key in one.tiles(epoch)] == [other.stamp_ns(epoch, key) for key in other.tiles(epoch)]
    assert sorted(path.name for path in tmp_path.glob("*3*")) == ["3.egmap"]  # one file: no WAL beside it
    export(stored, tmp_path / "part.egmap", box=(31.9, -5.0, 32.0, 1.0))  # m: the last column of tile 0 alone
    with TileStore(tmp_path / "part.egmap") as part:
        assert part.tiles(3) == [(0, 0)]


def test_an_npz_holds_every_cell_and_comes_back(stored: Path, tmp_path: Path) -> None:
    export(stored, tmp_path / "map.npz")
    export(stored, tmp_path / "again.npz")
    assert (tmp_path / "map.npz").read_bytes() == (tmp_path / "again.npz").read_bytes()
    log_odds, origin = window(stored)
    with np.load(tmp_path / "map.npz") as file:
        assert set(file) == {"log_odds", "origin", "cell", "seen_s", "radars", "measured", "names"}
        np.testing.assert_array_equal(file["log_odds"], log_odds)
        assert (file["origin"].tolist(), file["cell"], file["names"].tolist()) == (list(origin), CELL, list(NAMES))
        with TileStore(stored) as store:
            occupancy = stored_map(store, 3)
            where = (round(origin[1] / CELL), round(origin[0] / CELL), *log_odds.shape)
            seen_s, radars = occupancy.window_of_views(*where)
            np.testing.assert_array_equal(file["seen_s"], seen_s)
            np.testing.assert_array_equal(file["radars"], radars)
            np.testing.assert_array_equal(file["measured"], occupancy.window_of_layers(*where)[2:].any(axis=0) & (log_odds != 0))
    sentence = import_map(tmp_path / "map.npz", tmp_path / "back.egmap", vehicle="van")
    assert sentence.endswith(f"not in {tmp_path / 'map.npz'}: what was measured and what learned")
    export(tmp_path / "back.egmap", tmp_path / "back.npz")
    one, two = read_npz(tmp_path / "map.npz"), read_npz(tmp_path / "back.npz")
    assert (one.origin, one.cell, one.names) == (two.origin, two.cell, two.names)
    for name in ("log_odds", "seen_s", "radars"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    with TileStore(tmp_path / "back.egmap") as store:
        what = store.description(1)
        assert (what.kind, what.vehicle, what.begun_ns) == ("sum", "van", int(one.seen_s[one.seen_s > 0].min()) * 10**9)


@pytest.mark.parametrize("mode", map_server.MODES)
def test_map_server_files_go_out_and_come_back(stored: Path, tmp_path: Path, mode: str) -> None:
    yaml = tmp_path / "map.yaml"
    sentence = export(stored, yaml, epoch=1, mode=mode)
    log_odds, origin = window(stored, 1)
    assert sentence.startswith(f"{yaml}: {log_odds.shape[1]} x {log_odds.shape[0]} cells of 0.25 m; not in it: ")
    header = map_server.read_header(yaml)
    assert (header.origin, header.cell, header.mode) == (origin, CELL, mode)
    np.testing.assert_array_equal(pixels(header.image), map_server.pixels_of(log_odds, mode))
    sentence = import_map(yaml, tmp_path / "back.egmap")
    assert "probabilities finer than the picture's" in sentence
    assert "when a cell was in view, by which radar" in sentence
    assert "moved" not in sentence
    export(tmp_path / "back.egmap", tmp_path / "back.yaml", mode=mode)
    back, again = map_server.read(yaml), map_server.read(tmp_path / "back.yaml")
    known = back.log_odds != 0
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    np.testing.assert_array_equal(back.log_odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], again.log_odds)
    assert again.origin == (origin[0] + columns[0] * CELL, origin[1] + rows[0] * CELL)


def test_a_box_cuts_the_cells_that_it_touches(stored: Path, tmp_path: Path) -> None:
    export(stored, tmp_path / "map.npz", box=parse_box("-1.1,5.25,40,31.9"))
    with np.load(tmp_path / "map.npz") as file, TileStore(stored) as store:
        assert file["origin"].tolist() == [-1.25, 5.25]
        np.testing.assert_array_equal(file["log_odds"], stored_map(store, 3).window(21, -5, 107, 165))


def test_a_picture_has_a_pixel_for_each_cell(stored: Path, tmp_path: Path) -> None:
    export(stored, tmp_path / "map.png")
    np.testing.assert_array_equal(pixels(tmp_path / "map.png"), shade(window(stored)[0])[::-1])


def test_maps_that_no_picture_can_hold(tmp_path: Path) -> None:
    """A road of 320 km: shown, exported as a store or in parts, but not as one picture, and no memory is asked for."""
    tiles = random_tiles(5, ((0, 0), (10_000, 10_000)))
    path = write_store(tmp_path / "far.egmap", tiles)
    with pytest.raises(EchogridError, match=r"epoch 1: \d+ x \d+ cells \(320.0 x 320.0 km\) are more than the 64 Mi that one .* --bbox"):
        export(path, tmp_path / "map.npz")
    assert [path.name for path in tmp_path.glob("*map.npz*")] == []
    export(path, tmp_path / "map.npz", box=(319_990.0, 319_990.0, 320_040.0, 320_040.0))
    assert (read_npz(tmp_path / "map.npz").log_odds != 0).sum() > 500
    export(path, tmp_path / "copy.egmap")
    assert content(tmp_path / "copy.egmap") == content(path)
    with pytest.raises(EchogridError, match="epoch 1: spreads over 320 x 320 km, too far for a picture"):
        show(path)
    seen = show(write_store(tmp_path / "road.egmap", random_tiles(5, ((0, 0), (1, 60_000)))))
    assert seen.shape[0] <= 2
    assert 900 <= seen.shape[1] <= 1600
    assert (np.count_nonzero(seen[:, 1:-1]), bool(seen[0, 0]), bool(seen[-1, -1])) == (0, True, True)


def test_the_limit_is_one_that_pillow_opens_without_a_warning() -> None:
    assert Image.MAX_IMAGE_PIXELS is not None
    assert MOST_CELLS <= Image.MAX_IMAGE_PIXELS
