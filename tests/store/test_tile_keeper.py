"""A running map and its file: what is in memory, on its way and on disk is one map, and a disk that fails is a state."""

from __future__ import annotations

import errno
import hashlib
import os
import sqlite3
import threading
from pathlib import Path

import numpy as np
import pytest
from tests.support import disk

from echogrid.config.tables import Store
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.tile import SIDE, Tile, TileKey
from echogrid.core.map.tiled_map import View
from echogrid.core.motion.se2 import SE2
from echogrid.store import store_file
from echogrid.store.store_file import ForeignFileError, StoreError
from echogrid.store.stored_map import describe, stored_map
from echogrid.store.tile_keeper import MOST_WAITING, TileKeeper
from echogrid.store.tile_store import TileStore

SPEC = GridSpec(cells=32, cell=0.25)
SIDE_M = SIDE * SPEC.cell


class Car:
    """Drives a map of its own, update after update, one second each."""

    def __init__(self, max_tiles: int, seed: int = 0) -> None:
        self.map = LookMap(SPEC, Calibration(), max_tiles=max_tiles)
        self.rng = np.random.default_rng(seed)
        self.seconds = 0

    def visit(self, row: int, column: int) -> None:
        """One update in the middle of a tile."""
        self.seconds += 1
        pose = SE2((column + 0.5) * SIDE_M, (row + 0.5) * SIDE_M, 0.3)
        view = View(self.seconds * 10**9, np.ones((32, 32), np.uint16))
        self.map.integrate(self.rng.uniform(0.1, 1, (2, 32, 32)).astype(np.float32), pose, view)

    def drive(self, updates: int) -> None:
        for _ in range(updates):
            self.visit(*self.rng.integers(-3, 3, 2).tolist())


def keeper(path: Path, car: Car, settings: Store | None = None) -> TileKeeper:
    kept = TileKeeper(path, settings or Store(), car.map, describe(car.map, "car", ("front",), 1), threading.Lock())
    car.map.shelf = kept
    return kept


def everything(occupancy: object) -> bytes:
    assert isinstance(occupancy, LookMap)
    bounds = occupancy.bounds()
    views = occupancy.window_of_views(*bounds)
    return b"".join(array.tobytes() for array in (np.array(bounds), occupancy.window_of_layers(*bounds), *views))


def in_file(path: Path, epoch: int) -> bytes:
    with TileStore(path) as store:
        return everything(stored_map(store, epoch))


def digest(tile: Tile) -> bytes:
    return hashlib.sha256(tile.layers.tobytes() + tile.radars.tobytes()).digest()


def roomy(updates: int, seed: int = 0) -> bytes:
    """What such a drive makes with room for all."""
    car = Car(4096, seed)
    car.drive(updates)
    return everything(car.map)


def test_memory_disk_and_what_is_between_are_one_map(tmp_path: Path) -> None:
    """Flushed at odd moments, with room for four tiles of 36; at the end the file alone has all of it."""
    car = Car(max_tiles=4)
    with keeper(tmp_path / "a.egmap", car) as kept:
        for n in range(120):
            car.drive(1)
            if n % 11 == 0:
                kept.flush()
        assert len(car.map.tiles) == 4
        assert kept.status.forgotten == 0
        assert everything(car.map) == roomy(120)
    assert in_file(tmp_path / "a.egmap", 1) == roomy(120)
    assert (kept.status.state, kept.status.reason, kept.status.failed) == ("ok", "", 0)
    assert kept.status.mib * (1 << 20) == (tmp_path / "a.egmap").stat().st_size


def test_while_a_thread_flushes_as_fast_as_it_can_the_map_is_the_same(tmp_path: Path) -> None:
    """Whatever moment a copy is taken at; and snapshots from a third thread are always of a whole update."""
    car = Car(max_tiles=4)
    stop = threading.Event()
    snapshots: list[tuple[TileKey, Tile]] = []
    truth: dict[tuple[TileKey, int], bytes] = {}  # digest of each tile after each update, which changes one alone
    with keeper(tmp_path / "a.egmap", car) as kept:

        def flush() -> None:
            while not stop.is_set():
                kept.flush()

        def ask() -> None:
            rng = np.random.default_rng(1)
            while not stop.is_set():
                row, column = rng.integers(-3, 3, 2).tolist()
                tile = kept.snapshot((row, column))
                if tile is not None and len(snapshots) < 500:
                    snapshots.append(((row, column), tile))

        threads = [threading.Thread(target=work) for work in (flush, ask)]
        for thread in threads:
            thread.start()
        while car.seconds < 250 or (len(snapshots) < 10 and car.seconds < 10_000):  # on a busy machine a thread may wait long for its turn
            with kept.lock:
                car.drive(1)
                *_, (key, tile) = car.map.tiles.items()  # the one used last
                truth[key, car.seconds] = digest(tile)
        stop.set()
        for thread in threads:
            thread.join()
        assert len(snapshots) >= 10
        for key, tile in snapshots:
            assert digest(tile) == truth[key, int(tile.seen_s.max())]
        assert kept.status.failed == kept.status.forgotten == 0
        assert everything(car.map) == roomy(car.seconds)
    assert in_file(tmp_path / "a.egmap", 1) == roomy(car.seconds)


def test_the_thread_flushes_when_due_and_early_where_many_wait(tmp_path: Path) -> None:
    car = Car(max_tiles=1)
    with keeper(tmp_path / "a.egmap", car, Store(flush_s=3600.0)) as kept:
        assert not kept.due()
        for column in range(MOST_WAITING // 2 + 1):
            assert not kept.due()
            car.visit(0, column)
        car.visit(1, 0)
        assert kept.due()
        stop = threading.Event()
        thread = threading.Thread(target=kept.run, args=(stop,))
        thread.start()
        while not kept.status.written:
            assert not stop.wait(0.01)
        stop.set()
        thread.join()
        assert not kept.due()


def test_a_map_begun_anew_is_another_epoch_and_the_old_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    for first in (1, 4):  # and again after a restart
        car = Car(max_tiles=3, seed=first)
        with keeper(path, car) as kept:
            assert kept.epoch == first == kept.status.epoch
            for epoch in (first, first + 1, first + 2):
                car.drive(20)
                if epoch == first:
                    kept.flush()
                if epoch < first + 2:
                    car.map.clear(car.seconds * 10**9 + 5)
                    assert car.map.bounds() == (0, 0, 0, 0)
                    assert kept.snapshot((0, 0)) is None
            assert kept.epoch == first + 2
    with TileStore(path) as store:
        assert store.numbers() == [1, 2, 3, 4, 5, 6]
        assert [store.description(epoch).begun_ns for epoch in (1, 2, 3)] == [1, 20 * 10**9 + 5, 40 * 10**9 + 5]
    car = Car(4096, seed=1)
    for epoch in (1, 2, 3):
        car.drive(20)
        assert in_file(path, epoch) == everything(car.map)
        car.map.clear(0)


def test_a_full_disk_is_a_state_that_ends_with_it(tmp_path: Path) -> None:
    """Nothing is lost as long as memory holds it: when there is room again, the file gets all."""
    with disk.small(tmp_path / "disk", kib=2048) as folder:
        car = Car(max_tiles=64)
        ballast = folder / "ballast"
        with keeper(folder / "a.egmap", car) as kept:
            car.drive(5)
            kept.flush()
            assert kept.status.state == "ok"
            ballast.write_bytes(bytes(os.statvfs(folder).f_bavail * os.statvfs(folder).f_frsize))
            car.drive(30)
            for failed in (1, 2):
                kept.flush()
                assert (kept.status.state, kept.status.failed) == ("full", failed)
                assert kept.status.reason == f"{folder / 'a.egmap'}: database or disk is full; mapping continues in memory"
            assert everything(car.map) == roomy(35)
            ballast.unlink()
            kept.flush()
            assert (kept.status.state, kept.status.reason, kept.status.forgotten) == ("ok", "", 0)
        assert in_file(folder / "a.egmap", 1) == roomy(35)


def test_a_full_disk_is_given_back_what_was_removed_from_it(tmp_path: Path) -> None:
    """The file and its log, by someone who makes room: a connection that reads would hold their blocks."""
    with disk.small(tmp_path / "disk", kib=1024) as folder:
        car = Car(max_tiles=4)
        with keeper(folder / "a.egmap", car) as kept:
            car.drive(40)
            kept.flush()
            car.map.window(-3 * SIDE, -3 * SIDE, 6 * SIDE, 6 * SIDE)  # reads what has no room in memory
            assert kept.status.state == "ok"
            (folder / "ballast").write_bytes(bytes(os.statvfs(folder).f_bavail * os.statvfs(folder).f_frsize))
            car.drive(20)
            kept.flush()
            assert kept.status.state == "full"
            for path in folder.glob("a.egmap*"):
                path.unlink()
            for _ in range(3):
                kept.flush()
            assert (kept.status.state, kept.status.reason) == ("ok", "")


def test_a_disk_that_is_full_from_the_start_and_too_little_memory_cost_the_oldest_tiles(tmp_path: Path) -> None:
    with disk.small(tmp_path / "disk", kib=64) as folder:
        (folder / "ballast").write_bytes(bytes(os.statvfs(folder).f_bavail * os.statvfs(folder).f_frsize))
        car = Car(max_tiles=2)
        with keeper(folder / "a.egmap", car) as kept:
            assert (kept.status.state, kept.epoch) == ("full", 1)
            for column in range(MOST_WAITING + 7):
                car.visit(0, column)
            assert not kept.due()
            kept.flush()
            assert kept.status.state == "full"
            assert kept.status.forgotten == 5  # of all but two in memory and MOST_WAITING
            assert car.map.window(0, 0, SIDE, 5 * SIDE).any() == 0
            assert car.map.window(0, 5 * SIDE, SIDE, SIDE).any()


def test_a_disk_that_is_read_only_is_a_state_and_epochs_count_on(tmp_path: Path) -> None:
    shown = tmp_path / "shown"
    shown.mkdir()
    first = Car(max_tiles=64)
    with keeper(shown / "a.egmap", first):
        first.drive(3)
    with disk.read_only(tmp_path / "disk", shown) as folder:
        car = Car(max_tiles=64)
        with keeper(folder / "a.egmap", car) as kept:
            assert (kept.status.state, kept.epoch) == ("read-only", 2)
            car.drive(20)
            kept.flush()
            assert everything(car.map) == roomy(20)
    assert in_file(shown / "a.egmap", 1) == roomy(3)


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    path.write_text("something else")
    with pytest.raises(ForeignFileError, match=r"a\.egmap: is not a map of echogrid"):
        keeper(path, Car(16))
    assert path.read_text() == "something else"


def test_a_torn_file_is_a_state_and_is_left_as_it_is_until_it_is_moved_away(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    car = Car(max_tiles=64)
    with keeper(path, car):
        car.drive(30)
    torn = bytearray(path.read_bytes())
    torn[100:4096] = os.urandom(3996)  # the first page after its header: the list of tables
    path.write_bytes(torn)
    car = Car(max_tiles=64)
    with keeper(path, car) as kept:
        assert kept.status.state == "failed"
        assert str(path) in kept.status.reason
        car.drive(10)
        kept.flush()
        assert kept.status.state == "failed"
        assert path.read_bytes() == torn
        path.rename(tmp_path / "torn")
        kept.flush()
        assert kept.status.state == "ok"
    assert in_file(path, kept.epoch) == roomy(10)


def test_a_disk_that_dies_is_a_state_and_no_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where its cable is pulled: nothing on it can even be looked for."""
    car = Car(max_tiles=64)
    with keeper(tmp_path / "a.egmap", car) as kept:
        car.drive(3)

        def dead(*_: object, **__: object) -> None:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

        with monkeypatch.context() as pulled:
            pulled.setattr(Path, "stat", dead)
            pulled.setattr(Path, "is_dir", dead)
            pulled.setattr(store_file, "_connect", dead)
            kept.flush()
            assert (kept.status.state, kept.status.reason) == (
                "failed",
                f"{tmp_path / 'a.egmap'}: Input/output error; mapping continues in memory",
            )
            failed = sqlite3.OperationalError("disk I/O error")
            failed.sqlite_errorcode = sqlite3.SQLITE_IOERR  # type: ignore[misc]
            with pytest.raises(StoreError, match="disk I/O error"), store_file.sqlite_errors(tmp_path / "a.egmap"):
                raise failed
        kept.flush()
        assert kept.status.state == "ok"


def test_a_file_that_is_taken_away_is_begun_anew_with_all_that_memory_holds(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    car = Car(max_tiles=20)
    with keeper(path, car) as kept:
        car.drive(100)
        kept.flush()
        shelved = len(kept.keys() - car.map.tiles.keys())
        assert shelved > 10
        path.rename(tmp_path / "taken")
        kept.flush()
        assert (kept.status.state, kept.status.forgotten) == ("ok", shelved)
        with TileStore(path) as store:
            assert set(store.tiles(kept.epoch)) == car.map.tiles.keys()
        car.drive(10)
        whole = everything(car.map)
    assert in_file(path, 1) == whole


def test_another_process_that_writes_the_same_file_is_a_state(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    car = Car(max_tiles=64)
    with keeper(path, car) as kept:
        with TileStore(path, write=True) as other:
            assert other.begin(describe(car.map, "car", ("front",), 1)) == 2
        car.map.clear(0)  # whose number is taken
        car.drive(5)
        kept.flush()
        assert kept.status.state == "failed"
        assert kept.status.reason.endswith(
            "epoch 2 should start, but 2 has started: another process writes this file; mapping continues in memory"
        )


def test_older_epochs_make_room_the_oldest_first(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    settings = Store(max_mib=1)
    for _ in range(4):
        car = Car(max_tiles=64)
        with keeper(path, car, settings) as kept:
            car.drive(150)
            kept.flush()
            assert kept.status.state == "ok"
    size = path.stat().st_size
    assert size <= 1 << 20
    with TileStore(path) as store:
        assert store.numbers() == list(range(5 - len(store.numbers()), 5))
        assert 1 < len(store.numbers()) < 4
        for epoch in store.numbers():
            assert everything(stored_map(store, epoch)) == roomy(150)  # what is there is whole


def test_a_running_map_beyond_the_limit_loses_its_oldest_tiles_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    car = Car(max_tiles=4)
    with keeper(path, car, Store(max_mib=2)) as kept:
        first = kept.epoch
        for column in range(400):
            car.visit(0, column)
            if column % 20 == 0:
                kept.flush()
        kept.flush()
        assert path.stat().st_size <= 2 << 20
        assert kept.status.forgotten > 0
        held = kept.keys()
        assert len(held) + kept.status.forgotten == 400
        assert min(column for _, column in held) == kept.status.forgotten  # the oldest
        everything(car.map)
    with TileStore(path) as store:
        assert store.numbers() == [first]


def test_a_damaged_tile_is_lost_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    car = Car(max_tiles=1)
    with keeper(path, car) as kept:
        for column in range(3):
            car.visit(0, column)
        kept.flush()
        connection = sqlite3.connect(path)
        connection.execute("UPDATE tile SET data = x'00' WHERE col = 0")
        connection.commit()
        connection.close()
        assert kept.snapshot((0, 0)) is None
        assert not car.map.window(0, 0, SIDE, SIDE).any()
        assert (kept.status.state, kept.status.forgotten) == ("failed", 1)
        assert "tile (0, 0) of epoch 1 is damaged" in kept.status.reason
        assert car.map.window(0, SIDE, SIDE, SIDE).any()
        kept.flush()
        assert kept.status.state == "ok"
