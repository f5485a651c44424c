"""`--store` and [store]: a replay that has its tiles on disk, and a service that keeps its map over restarts."""

from __future__ import annotations

import dataclasses
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.support import world
from tests.support.ports import free_port
from tests.support.waiting import PATIENCE, until

from echogrid.can.intake.frames import FrameBatch
from echogrid.client import Client
from echogrid.commands.replay import replay
from echogrid.config.loading import load_config
from echogrid.config.tables import Store
from echogrid.errors import EchogridError
from echogrid.live.player import AHEAD_FRAMES, on_virtual_buses, senders
from echogrid.live.service import Service, store_path
from echogrid.logs.drive import Drive, find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore

SMALL_CELLS = "\n[grid]\ncell = 0.05\n"  # a tile is 6.4 m, so that a short drive has many


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """Once round a circle of 20 m, and on for a while where it has been."""
    posts = world.standing([(float(x), float(y)) for x in range(-28, 29, 8) for y in range(-8, 49, 8)])
    messages = world.record(world.circle(10.0, 0.5), [posts], 15.0)
    folder = world.write_drive(tmp_path_factory.mktemp("drive"), messages)
    (folder / "echogrid.toml").write_text(world.CONFIG + SMALL_CELLS)
    return find_drive(folder, None)


def with_tiles(drive: Drive, folder: Path, most: int) -> Drive:
    """The same with room for so many."""
    path = folder / f"{most}.toml"
    path.write_text(world.CONFIG + SMALL_CELLS + f"\n[map]\nmax_tiles = {most}\n[publish]\nwindow_cells = 128\n")
    return find_drive(drive.log, path)


def test_a_replay_with_sixteen_tiles_in_memory_is_bit_for_bit_the_one_with_all(drive: Drive, tmp_path: Path) -> None:
    path = tmp_path / "a.egmap"
    roomy = replay(drive, tmp_path / "roomy", store=path)
    kept = replay(with_tiles(drive, tmp_path, 16), tmp_path / "kept", store=path)
    assert roomy["map_sha256"] == kept["map_sha256"]
    assert (roomy["epoch"], kept["epoch"]) == (1, 2)
    assert (tmp_path / "roomy" / "map.pgm").read_bytes() == (tmp_path / "kept" / "map.pgm").read_bytes()
    with TileStore(path) as store:
        first, second = store.epochs()
        assert first.tiles == second.tiles > 40
        assert first.description.radars == tuple(world.RADARS)
        assert first.description.begun_ns <= 101 * 10**9 < first.newest_ns
        one, other = stored_map(store, 1), stored_map(store, 2)
        with np.load(tmp_path / "roomy" / "map.npz") as file:
            row, column, log_odds = other.whole()
            assert log_odds.tobytes() == file["log_odds"].tobytes()
            assert np.allclose(file["origin"], np.array((column, row)) * 0.05)
        bounds = one.bounds()
        for mine, theirs in zip(one.window_of_views(*bounds), other.window_of_views(*bounds), strict=True):
            np.testing.assert_array_equal(mine, theirs)
        seen_s, radars = one.window_of_views(*bounds)
        assert np.bitwise_or.reduce(radars, axis=None) == 0b1111
        assert {1, 2, 4, 8} & set(np.unique(radars).tolist())
        assert ((seen_s == 0) == (radars == 0)).all()
        assert seen_s[seen_s > 0].min() == 100
        assert seen_s.max() == first.newest_ns // 10**9


def test_a_replay_into_another_file_or_a_full_one_is_one_sentence(drive: Drive, tmp_path: Path) -> None:
    path = tmp_path / "notes.egmap"
    path.write_text("mine")
    with pytest.raises(EchogridError, match=r"notes\.egmap: is not a map of echogrid"):
        replay(drive, tmp_path / "out", store=path)
    assert path.read_text() == "mine"
    assert not (tmp_path / "out").exists()
    with pytest.raises(EchogridError, match=r"nowhere.a\.egmap: there is no folder "):
        replay(drive, tmp_path / "out", store=tmp_path / "nowhere" / "a.egmap")


def test_a_service_with_sixteen_tiles_keeps_the_map_of_the_log_bit_for_bit(drive: Drive, tmp_path: Path) -> None:
    """Over a bus, with a thread that flushes meanwhile."""
    small = with_tiles(drive, tmp_path, 16)
    config = on_virtual_buses(load_config(small.config))
    publish = msgspec.structs.replace(config.publish, listen=(f"tcp/127.0.0.1:{free_port()}",))
    config = msgspec.structs.replace(config, store=Store(path=str(tmp_path / "a.egmap"), flush_s=0.1), publish=publish)
    service = Service(Pipeline(config, small.config))
    roomy = Pipeline(load_config(drive.config), drive.config)
    sent = list(Log(drive.log))
    for _ in roomy.updates([FrameBatch.of(sent)]):
        pass

    def play() -> None:
        try:
            service.live.wait(PATIENCE)
            (bus,) = senders(config).values()
            for n, message in enumerate(sent):
                until(lambda n=n: n - service.pipeline.health.frames <= AHEAD_FRAMES)
                bus.send(message)
            until(lambda: service.pipeline.health.frames == len(sent) or service.workers.stop.is_set())
            bus.shutdown()
        finally:
            service.workers.stop.set()

    player = threading.Thread(target=play)
    player.start()
    service.run()
    player.join()
    expected = roomy.mapper.map
    status = service.status()["store"]
    assert (status["state"], status["failed"], status["forgotten"], status["epoch"]) == ("ok", 0, 0, 1)
    assert status["written"] > len(expected.tiles) > 40
    with TileStore(tmp_path / "a.egmap") as store:
        stored = stored_map(store, 1)
        bounds = expected.bounds()
        assert stored.bounds() == bounds
        assert stored.window_of_layers(*bounds).tobytes() == expected.window_of_layers(*bounds).tobytes()
        for one, other in zip(stored.window_of_views(*bounds), expected.window_of_views(*bounds), strict=True):
            np.testing.assert_array_equal(one, other)


def test_a_map_begun_after_the_clock_was_set_back_begins_by_the_new_clock(drive: Drive, tmp_path: Path) -> None:
    pipeline, path = Pipeline(load_config(drive.config), drive.config), tmp_path / "a.egmap"
    before = FrameBatch.joined(list(Log(drive.log).batches()), by_time=False)[0].where(slice(0, 1500))
    after = dataclasses.replace(before, stamps=before.stamps - 50.0)
    with pipeline.keep(path, round(float(before.stamps[0]) * 1e9), threading.Lock()):
        assert sum(1 for _ in pipeline.updates([before, after])) > 10
        pipeline.mapper.end_cycle()
    with TileStore(path) as store:
        one, other = store.epochs()
    for epoch, batch in ((one, before), (other, after)):
        assert epoch.newest_ns is not None
        assert batch.stamps[0] * 1e9 - 1 <= epoch.description.begun_ns <= epoch.newest_ns <= batch.stamps[-1] * 1e9


@pytest.fixture
def config(tmp_path: Path, port: int) -> tuple[Path, int]:
    """A service on a bus without traffic."""
    path = tmp_path / "echogrid.toml"
    path.write_text(world.CONFIG + f'\n[publish]\nlisten = ["tcp/127.0.0.1:{port}"]\n[store]\npath = "kept.egmap"\nflush_s = 0.1\n')
    return path, port


def test_a_service_counts_its_epochs_on_over_restarts_and_says_how_its_store_fares(config: tuple[Path, int], tmp_path: Path) -> None:
    path, port = config
    for run, end in enumerate((signal.SIGKILL, signal.SIGTERM), start=1):
        with subprocess.Popen([sys.executable, "-m", "echogrid", "run", "-c", str(path)], stderr=subprocess.DEVNULL) as service:
            with Client(f"tcp/127.0.0.1:{port}", "test") as client:
                status = client.status(PATIENCE)
            service.send_signal(end)
        assert status is not None
        assert status["epoch"] == status["store"]["epoch"] == run
        assert (status["store"]["state"], status["store"]["reason"], status["store"]["written"]) == ("ok", "", 0)
        with TileStore(tmp_path / "kept.egmap") as store:
            assert store.numbers() == [run]
            assert store.description(run).vehicle == "test"
            assert abs(store.description(run).begun_ns - time.time_ns()) < 60e9


def test_a_service_that_cannot_start_leaves_the_store_to_the_one_that_runs(config: tuple[Path, int]) -> None:
    """Started twice by mistake."""
    path, _ = config
    service = Service(Pipeline(load_config(path), path))
    running = threading.Thread(target=service.run)
    running.start()
    try:
        assert service.live.wait(PATIENCE)
        assert service.keeper is not None
        with pytest.raises(EchogridError, match="is being written by process"):
            Service(Pipeline(load_config(path), path)).run()
        with TileStore(service.keeper.path) as store:
            assert store.numbers() == [1]
            assert store.next_epoch() == 2
        service.pipeline.mapper.map.clear(0)
        until(lambda: service.keeper is not None and service.keeper.status.epoch == 2)
        assert service.keeper.status.state == "ok"
    finally:
        service.workers.stop.set()
        running.join()


def test_a_service_refuses_another_file_before_it_opens_anything(config: tuple[Path, int], tmp_path: Path) -> None:
    path, _ = config
    connection = sqlite3.connect(tmp_path / "kept.egmap")
    connection.execute("CREATE TABLE mine(a)")
    connection.close()
    command = [sys.executable, "-m", "echogrid", "run", "-c", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        f"echogrid: {path}: {tmp_path / 'kept.egmap'}: is not a map of echogrid: application id 0x00000000 found, expected 0x65676D70; "
        "name another file, or move this one away"
    ]


def test_where_the_map_is_kept(config: tuple[Path, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, _ = config
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    assert store_path(load_config(path)) == tmp_path / "kept.egmap"  # beside the configuration
    path.write_text(world.CONFIG)
    assert store_path(load_config(path)) is None
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/echogrid")
    assert store_path(load_config(path)) == Path("/var/lib/echogrid/map.egmap")
