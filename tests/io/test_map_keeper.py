"""The map on disk: whole or as it was, and a full disk stops nothing."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from echogrid.io import map_files
from echogrid.io.map_keeper import MapKeeper


def written(keeper: MapKeeper, log_odds: np.ndarray) -> None:
    stop = threading.Event()
    keeper.take(-3, 5, log_odds)
    stop.set()
    keeper.run(stop)


def test_what_was_taken_is_written_even_after_the_end_was_asked_for(tmp_path: Path) -> None:
    keeper, log_odds = MapKeeper(str(tmp_path), 0.25), np.arange(12, dtype=np.float32).reshape(3, 4)
    written(keeper, log_odds)
    with np.load(tmp_path / "map.npz") as held:
        np.testing.assert_array_equal(held["log_odds"], log_odds)
        assert held["origin"].tolist() == [1.25, -0.75]
    assert (keeper.written, keeper.failed, [path.name for path in tmp_path.iterdir()]) == (1, 0, ["map.npz"])


def test_a_write_that_fails_is_counted_and_leaves_the_older_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keeper = MapKeeper(str(tmp_path), 0.25)
    written(keeper, np.zeros((2, 2), np.float32))

    def full(file: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(map_files.os, "fsync", full)
    written(keeper, np.ones((2, 2), np.float32))
    assert (keeper.written, keeper.failed) == (1, 1)
    with np.load(tmp_path / "map.npz") as held:
        assert not held["log_odds"].any()


def test_without_a_folder_nothing_is_due() -> None:
    assert not MapKeeper(None, 0.25).due()
