"""A store that one process writes is refused to all others, as long as that one lives."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from tests.store.test_tile_keeper import Car, keeper
from tests.support import world
from tests.support.program import echogrid

from echogrid.store import claim
from echogrid.store.claim import Claim, HeldError, check_free
from echogrid.store.tile_store import TileStore

HOLDER = """
import sys
from pathlib import Path
from echogrid.store.claim import Claim
held = Claim(Path(sys.argv[1]))
held.hold()
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A store."""
    with TileStore(tmp_path / "a.egmap", write=True):
        return tmp_path / "a.egmap"


def test_who_holds_it_is_named_and_one_that_is_killed_leaves_nothing_behind(path: Path) -> None:
    before = sorted(path.parent.iterdir())
    command = [sys.executable, "-c", HOLDER, str(path), "/usr/bin/echogrid", "run", "-c", "e.toml"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(HeldError) as refused:
            Claim(path).hold()
        said = f"is being written by process {holder.pid} (echogrid run -c e.toml): wait for its end, or name another file"
        assert str(refused.value) == f"{path}: {said}"
        holder.kill()
    check_free(path)
    assert sorted(path.parent.iterdir()) == before


def test_without_the_kernels_list_it_is_another_process(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def closed(*_: object, **__: object) -> str:
        raise PermissionError

    held = Claim(path)
    held.hold()
    held.hold()
    monkeypatch.setattr(claim.Path, "read_text", closed)
    with pytest.raises(HeldError, match="is being written by another process: wait"):
        check_free(path)
    held.release()
    held.release()
    check_free(path)


def test_what_is_no_file_is_nobodys(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", ".", "none.egmap", "none/none.egmap"):  # the store says what they are
        check_free(tmp_path / name)


def test_a_file_system_without_locks_refuses_nobody(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr(claim.fcntl, "flock", none)
    claims = (Claim(path), Claim(path))
    for held in claims:
        held.hold()
    for held in claims:
        held.release()


def test_a_second_keeper_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    """As it is after its file was taken away."""
    path, car = tmp_path / "a.egmap", Car(max_tiles=64)
    with keeper(path, car) as kept:
        for _ in range(2):
            car.drive(5)
            with pytest.raises(HeldError, match=f"process {os.getpid()} "):
                keeper(path, Car(max_tiles=64))
            kept.flush()
            assert (kept.status.state, kept.status.epoch) == ("ok", 1)
            path.rename(tmp_path / "taken")
            kept.flush()
    with keeper(path, Car(max_tiles=64)) as kept:
        assert kept.epoch == 2


def test_a_file_that_another_has_put_in_the_place_of_ours_is_a_state(tmp_path: Path) -> None:
    path, car = tmp_path / "a.egmap", Car(max_tiles=64)
    with keeper(path, car) as kept:
        path.unlink()
        with keeper(path, Car(max_tiles=64)) as other:
            car.drive(5)
            kept.flush()
            assert kept.status.state == "failed"
            assert kept.status.reason.endswith("wait for its end, or name another file; mapping continues in memory")
            assert other.status.state == "ok"


@pytest.mark.parametrize(
    "words", ["run -c {drive}/echogrid.toml", "replay {drive} --store {store}", "replay {drive} --publish --store {store}"]
)
def test_every_writer_is_refused_before_it_begins(words: str, path: Path, port: int, tmp_path: Path) -> None:
    tables = f'\n[publish]\nlisten = ["tcp/127.0.0.1:{port}"]\n[store]\npath = "{path}"\n'
    drive = world.write_drive(
        tmp_path / "drive", world.record(world.straight(5.0), [world.standing([(9.0, 4.0)])], 0.5), world.CONFIG + tables
    )
    held = Claim(path)
    held.hold()
    with TileStore(path) as store:  # who only reads is not concerned
        assert store.numbers() == []
    done = echogrid(*words.format(drive=drive, store=path).split(), *(() if words[:3] == "run" else ("--out", tmp_path / "out")))
    assert done.returncode == 1
    assert f"{path}: is being written by process {os.getpid()} " in done.stderr.splitlines()[-1]
    assert "live on" not in done.stderr
    checked = echogrid("check", "-c", drive / "echogrid.toml")  # beside a service that runs
    assert checked.returncode == 0, checked.stderr
    held.release()
    with TileStore(path) as store:
        assert (store.numbers(), store.next_epoch()) == ([], 1)


def test_of_many_that_begin_at_once_one_writes(tmp_path: Path) -> None:
    """A file that is not there yet too."""
    path, began = tmp_path / "a.egmap", threading.Barrier(4)
    states: list[str] = []

    def write() -> None:
        began.wait()
        try:
            with keeper(path, Car(max_tiles=64)) as kept:
                states.append(kept.status.state)
                over.wait(60)
        except HeldError:
            states.append("refused")

    over = threading.Event()
    threads = [threading.Thread(target=write) for _ in range(4)]
    for thread in threads:
        thread.start()
    while len(states) < 4:
        over.wait(0.01)
    over.set()
    for thread in threads:
        thread.join()
    assert states.count("ok") == 1
    assert set(states) <= {"ok", "refused", "failed"}
