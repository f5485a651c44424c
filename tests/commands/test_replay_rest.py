"""What a replay says of a map that is not all there: no room in memory, no room in one rectangle, files of an earlier drive."""

from __future__ import annotations

import errno
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from tests.support import world
from tests.support.waiting import PATIENCE, until

from echogrid.cli import _parser
from echogrid.commands.replay import replay, reported
from echogrid.config.loading import load_config
from echogrid.core.radar import doppler_errors
from echogrid.errors import EchogridError, NoMapError
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.maps import map_files
from echogrid.maps.export import export
from echogrid.pipeline import Pipeline

SMALL = "\n[grid]\ncell = 0.1171875\n[map]\nmax_tiles = 16\n[publish]\nwindow_cells = 64\n"


@pytest.fixture(scope="module")
def motorway(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """180 m straight on between posts, with room for less of it."""
    posts = world.standing([(x * 1.5, side * 5.0) for x in range(-10, 140) for side in (-1, 1)])
    messages = world.record(lambda at: (30.0 * at, 0.0, 0.0), [posts], 6.0)
    return world.write_drive(tmp_path_factory.mktemp("motorway"), messages, world.CONFIG + SMALL)


def test_what_had_no_room_in_memory_is_said_and_a_store_has_it(motorway: Path, tmp_path: Path) -> None:
    drive = find_drive(motorway, None)
    short = replay(drive, tmp_path / "short")
    (note,) = [note for note in short["notes"] if "not in the map" in note]
    assert note.endswith("more than 16 in memory (map.max_tiles, map.max_mib); --store FILE.egmap keeps all")
    kept = replay(drive, tmp_path / "kept", store=tmp_path / "all.egmap")
    assert not [note for note in kept["notes"] if "not in the map" in note]
    assert kept["map_sha256"] != short["map_sha256"]
    begins = [
        float((folder / "map.yaml").read_text().split("origin: [")[1].split(",")[0]) for folder in (tmp_path / "short", tmp_path / "kept")
    ]
    assert begins[0] > begins[1] + 15.0  # m: its begin is missing


def test_a_map_beyond_one_rectangle_is_not_written_which_is_no_success(
    motorway: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And nothing of an earlier drive is left in its place; what else there is, stays."""
    drive, out = find_drive(motorway, None), tmp_path / "out"
    replay(drive, out)
    (out / "mine.txt").touch()
    monkeypatch.setattr(map_files, "MOST_CELLS", 1 << 14)
    summary = replay(drive, out, store=tmp_path / "all.egmap")
    assert {path.name for path in out.iterdir()} == {"summary.json", "trajectory.csv", "mine.txt"}
    assert summary["files"] == ["summary.json", "trajectory.csv"]
    assert summary["map_sha256"] is None
    assert summary["not_to_be_trusted"] is None
    with pytest.raises(EchogridError, match=r"the map reaches over 0\.2 x 0\.0 km, more than .*--store FILE.egmap keeps it"):
        reported(summary, drive, out, as_json=True)
    assert json.loads(capsys.readouterr().out)["faults"] == summary["faults"]
    export(tmp_path / "all.egmap", tmp_path / "part.png", box=(0.0, -10.0, 20.0, 10.0))


def test_a_drive_without_a_map_leaves_no_map_of_an_earlier_one(motorway: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    replay(find_drive(motorway, None), out)
    assert (out / "map.png").is_file()
    frames = (motorway / "can.log").read_text().splitlines(keepends=True)
    only_motion = tmp_path / "motion.log"
    only_motion.write_text("".join(frame for frame in frames if " 10" in frame))
    with pytest.raises(NoMapError):
        replay(find_drive(only_motion, motorway / "echogrid.toml"), out)
    assert {path.name for path in out.iterdir()} == {"summary.json"}


def test_sigterm_leaves_a_whole_recording_and_the_tiles_so_far(motorway: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", "-m", "echogrid", "replay", str(motorway), "--realtime", "--out", str(tmp_path / "out")]
    command += ["--record", str(tmp_path / "a.mcap"), "--store", str(tmp_path / "a.egmap")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        until((tmp_path / "a.egmap").exists)
        time.sleep(1.0)  # of the drive's six seconds
        program.send_signal(signal.SIGTERM)
        _, logged = program.communicate(timeout=PATIENCE)
    assert (program.returncode, logged) == (130, "")
    with (tmp_path / "a.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    with closing(sqlite3.connect(tmp_path / "a.egmap")) as store:
        ((tiles,),) = store.execute("SELECT COUNT(*) FROM tile")
    assert tiles > 0


def test_a_run_that_ends_while_it_writes_leaves_nothing_of_an_earlier_one(
    motorway: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No summary that is of another map, and no picture beside the origin of another."""
    drive, out = find_drive(motorway, None), tmp_path / "out"
    replay(drive, out)

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(map_files.map_server, "write", full)
    with pytest.raises(OSError, match="No space left on device"):
        replay(drive, out)
    assert {path.name for path in out.iterdir()} == {"trajectory.csv", "map.npz"}


def test_true_poses_of_another_time_are_not_compared(motorway: Path, tmp_path: Path) -> None:
    """The log of one drive beside the truth of another: no number, least of all one that is none in JSON."""
    folder = tmp_path / "drive"
    folder.mkdir()
    for name in ("echogrid.toml", "can.log"):
        (folder / name).write_bytes((motorway / name).read_bytes())
    stamps = np.arange(100, 107, 0.1) * 1e9
    for shift, told in ((0, True), (1e12, False)):
        np.savez(
            folder / "truth.npz", stamp_ns=(stamps + shift).astype(np.int64), x=30 * (stamps * 1e-9 - 100), y=0 * stamps, yaw=0 * stamps
        )
        summary = replay(find_drive(folder, None), tmp_path / "out")
        assert ("trajectory_rmse_m" in summary) is told
        assert ("the true poses beside the recording are of other times, and are not used" in summary["notes"]) is not told
        json.loads((tmp_path / "out" / "summary.json").read_text(), parse_constant=pytest.fail)


def test_what_a_replay_has_learned_includes_its_last_cycle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Which nothing ends: three radars' scans wait for the fourth's."""
    monkeypatch.setattr(doppler_errors, "PERIOD_NS", 0)
    messages = world.record(world.straight(5.0), [world.standing([(x * 0.3, 6.0) for x in range(-20, 60)])], 1.0)
    while messages[-1].arbitration_id != 0x321:
        messages.pop()
    drive = find_drive(world.write_drive(tmp_path, messages, world.CONFIG), None)
    file = Pipeline(load_config(drive.config), drive.config)
    assert sum(1 for _ in file.updates(Log(drive.log).batches())) > 10
    assert file.mapper.end_cycle() is not None
    before = file.mapper.odometry.errors.learned()
    file.mapper.learn()
    assert replay(drive, tmp_path / "out")["learned"] == file.mapper.odometry.errors.learned() != before


@pytest.mark.parametrize(
    "words", ["replay {} -c e.toml --learn-first", "replay {} -c e.toml --publish --store a.egmap", "init {}", "bench {} -c e.toml"]
)
def test_a_pipe_is_refused_where_it_would_be_read_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str) -> None:
    """It waited for ever for a second writer."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo("a.log")
    Path("e.toml").write_text(world.CONFIG)
    given = _parser().parse_args(words.format("a.log").split())
    with pytest.raises(EchogridError, match="a.log: is a pipe, which can be read once, expected a file"):
        given.command(given)
