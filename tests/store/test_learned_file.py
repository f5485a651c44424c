"""What was learned of a car comes back as it was, for that car alone."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

from echogrid.core.motion.error_filter import ErrorFilter, Kept
from echogrid.errors import EchogridError
from echogrid.store.learned_file import keep, recall

KEPT = ErrorFilter(("left", "right")).keep()
SIZE = len(KEPT.mean)


def test_what_was_kept_is_recalled_bit_for_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(SIZE, SIZE))
    kept = Kept(rng.normal(size=SIZE), root @ root.T)
    keep(tmp_path / "map.learned.json", "car", kept)
    again = recall(tmp_path / "map.learned.json", "car", SIZE)
    assert again is not None
    assert (again.mean == kept.mean).all()
    assert (again.covariance == kept.covariance).all()


def test_of_another_car_or_version_or_of_none_nothing_is_recalled(tmp_path: Path) -> None:
    path = tmp_path / "map.learned.json"
    assert recall(path, "car", SIZE) is None
    keep(path, "car", KEPT)
    assert recall(path, "the same car with a radar turned", SIZE) is None
    path.write_text(json.dumps(json.loads(path.read_text()) | {"version": 2}))
    assert recall(path, "car", SIZE) is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mean": "?"}, "is not what echogrid learned"),
        ({"more": 1}, "is not what echogrid learned"),
        ({"mean": [0.0]}, "1 errors found, expected 12"),
        ({"mean": [1e999] * SIZE}, "is not what echogrid learned|is none"),
        ({"covariance": np.zeros((SIZE, SIZE)).tolist()}, "holds a covariance that is none"),
    ],
)
def test_a_file_that_is_something_else_is_named(tmp_path: Path, change: dict[str, object], said: str) -> None:
    path = tmp_path / "map.learned.json"
    keep(path, "car", KEPT)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(EchogridError, match=said) as raised:
        recall(path, "car", SIZE)
    assert str(path) in str(raised.value)


def test_garbage_is_named(tmp_path: Path) -> None:
    path = tmp_path / "map.learned.json"
    path.write_bytes(b"\xff\x00{")
    with pytest.raises(EchogridError, match="map.learned.json: is not what echogrid learned"):
        recall(path, "car", SIZE)


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(EchogridError, match="cannot be written: No such file"):
        keep(tmp_path / "nowhere" / "map.learned.json", "car", KEPT)


def test_on_a_dead_disk_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def dead(_: Path) -> bool:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(Path, "exists", dead)
    with pytest.raises(EchogridError, match=r"map\.learned\.json: cannot be read: Input/output error$"):
        recall(tmp_path / "map.learned.json", "", 3)
