"""The file of a store: what is none, what is torn, and a disk that cannot be written."""

from __future__ import annotations

import sqlite3
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from tests.support import disk
from tests.support.stores import LOOKS, filled, same

from echogrid.store.store_file import ForeignFileError, StoreError
from echogrid.store.tile_store import TileStore


def foreign_database(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.executescript("CREATE TABLE other(a); INSERT INTO other VALUES (1)")
    connection.close()


def other_tables(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.executescript(
        "PRAGMA application_id = 0x65676d70; PRAGMA user_version = 2; CREATE TABLE tile(a); CREATE VIEW epoch AS SELECT 1"
    )
    connection.close()


def newer(path: Path) -> None:
    TileStore(path, write=True).close()
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 3")
    connection.close()


@pytest.mark.parametrize("write", [False, True])
@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda path: path.write_bytes(b"x" * 5000), "is not a map of echogrid: it is not an SQLite file"),
        (lambda path: path.write_text("[map]"), "is not a map of echogrid: it is not an SQLite file"),
        (foreign_database, "is not a map of echogrid: application id 0x00000000 found, expected 0x65676D70"),
        (other_tables, "is not a map of echogrid: tables epoch, tile found, expected epoch, tile as this version makes them"),
        (newer, "a map of version 3 found, expected 2: update echogrid, or name another file"),
    ],
)
def test_another_file_is_one_sentence_and_stays_as_it_is(tmp_path: Path, make: object, sentence: str, write: bool) -> None:
    assert callable(make)
    path = tmp_path / "a.egmap"
    make(path)
    before = path.read_bytes()
    with pytest.raises(ForeignFileError) as refused:
        TileStore(path, write=write)
    assert str(refused.value).startswith(f"{path}: ")
    assert sentence in str(refused.value)
    assert path.read_bytes() == before


def test_a_file_that_is_not_there_or_empty_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    with pytest.raises(StoreError, match=r"a\.egmap: unable to open database file"):
        TileStore(path)
    path.touch()
    with pytest.raises(StoreError, match=r"a\.egmap: is empty"):
        TileStore(path)
    with TileStore(path, write=True) as store:  # what a process leaves that was killed at its first breath
        assert store.begin(LOOKS) == 1
    with pytest.raises(StoreError, match=r"nowhere.a\.egmap: there is no folder .*nowhere$"):
        TileStore(tmp_path / "nowhere" / "a.egmap", write=True)


@pytest.mark.parametrize("statements", range(20))
def test_one_who_ends_while_the_file_is_made_leaves_one_that_can_be_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, statements: int
) -> None:
    """After so many statements, as with a loss of power: then it is none of others, and the next one makes it."""

    class EndError(Exception):
        pass

    class Ending(sqlite3.Connection):
        done = 0

        def execute(self, *asked: str) -> sqlite3.Cursor:  # type: ignore[override]
            if Ending.done == statements:
                raise EndError
            Ending.done += 1
            return super().execute(*asked)

    path = tmp_path / "a.egmap"
    with monkeypatch.context() as patch:
        patch.setattr(sqlite3, "connect", partial(sqlite3.connect, factory=Ending))
        with suppress(EndError):
            TileStore(path, write=True).close()
    with suppress(StoreError):  # empty, or not there
        TileStore(path).close()
    with TileStore(path, write=True) as store:
        assert store.begin(LOOKS) == 1


@pytest.mark.parametrize("seed", range(12))
def test_a_torn_file_gives_right_tiles_or_a_sentence(tmp_path: Path, seed: int) -> None:
    """Cut short, or with some bytes overwritten: never another tile than the one that was written, never a traceback."""
    path, rng = tmp_path / "a.egmap", np.random.default_rng(seed)
    made = filled(path)
    data = bytearray(path.read_bytes())
    if seed % 3 == 0:
        del data[int(rng.integers(1, len(data))) :]
    else:
        for place in rng.integers(0 if seed % 3 == 1 else 4096, len(data), 40):
            data[place : place + 64] = rng.bytes(64)
    path.write_bytes(data)
    told: list[str] = []
    try:
        with TileStore(path) as store:
            for key, tile in made.items():
                try:
                    found = store.read(1, key)
                    assert found is None or same(found, tile)
                    told += [] if found else [f"{path}: {key} is gone"]
                except StoreError as error:
                    told.append(str(error))
    except (StoreError, ForeignFileError) as error:
        told.append(str(error))
    assert told
    assert all(sentence.startswith(f"{path}: ") for sentence in told)


@pytest.mark.parametrize("beside", [(), ("a.egmap-wal",)])
def test_a_map_on_a_disk_that_cannot_be_written_is_read(tmp_path: Path, beside: tuple[str, ...]) -> None:
    """Also one that was copied with the empty log that a reader leaves."""
    shown = tmp_path / "shown"
    shown.mkdir()
    made = filled(shown / "a.egmap", tiles=2)
    for name in beside:
        (shown / name).write_bytes(b"")
    with disk.read_only(tmp_path / "disk", shown) as folder:
        with TileStore(folder / "a.egmap") as store:
            assert same(store.read(1, (1, 0)), made[1, 0])
        for name in ("a.egmap", "b.egmap"):  # one that is there, and one that cannot be made
            with pytest.raises(StoreError) as refused, TileStore(folder / name, write=True) as store:
                store.begin(LOOKS)
            assert refused.value.state == "read-only"
    assert sorted(path.name for path in shown.iterdir()) == ["a.egmap", *beside]
