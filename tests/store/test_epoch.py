"""What describes an epoch, as it comes out of the file."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest
from tests.support.stores import SUM, filled

from echogrid.errors import EchogridError
from echogrid.store.epoch import Epoch
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("cell", -1.0),
        ("cell", "x"),
        ("kind", "mean"),
        ("clamp", 0.0),
        ("calibration", "[1]"),
        ("calibration", "[1e999, 0]"),
        ("calibration", b"\xff"),
        ("radars", '["a", 3]'),
        ("radars", str([f"r{n}" for n in range(17)]).replace("'", '"')),
        ("begun_ns", "now"),
    ],
)
def test_an_epoch_that_cannot_be_is_one_sentence(tmp_path: Path, column: str, value: object) -> None:
    path = tmp_path / "a.egmap"
    filled(path, tiles=1)
    connection = sqlite3.connect(path)
    connection.execute(f"UPDATE epoch SET {column} = ?", (value,))
    connection.commit()
    connection.close()
    with TileStore(path) as store:
        with pytest.raises(EchogridError, match=r"a\.egmap: epoch 1"):
            store.epochs()
        with pytest.raises(EchogridError, match=r"a\.egmap: epoch 1"):
            stored_map(store, 1)


def test_an_epoch_without_tiles_has_no_newest_stamp(tmp_path: Path) -> None:
    with TileStore(tmp_path / "a.egmap", write=True) as store:
        store.begin(SUM)
        assert store.epochs() == (Epoch(1, SUM, 0, 0, None),)
