"""A recording played to subscribers: the map of the file, at the recording's pace, with all that a service says."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import zenoh
from tests.support import world
from tests.support.playing import playing, published_drive
from tests.support.program import echogrid
from tests.support.waiting import PATIENCE, until

from echogrid.client import Client
from echogrid.commands.replay import replay
from echogrid.commands.showing.publish import publish
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid.store.tile_store import TileStore
from echogrid.zenoh.publisher import session_config

SECONDS, SPEED = 12.0, 4.0


def test_subscribers_get_the_map_of_the_file_at_its_pace(endpoint: str, tmp_path: Path) -> None:
    drive = published_drive(tmp_path / "drive", endpoint, SECONDS)
    keys: set[str] = set()
    began = time.monotonic()
    with (
        playing(drive, tmp_path / "out", SPEED) as run,
        Client(endpoint, "test") as client,
        zenoh.open(session_config((), (endpoint,), sends=False)) as session,
    ):
        everything = session.declare_subscriber("**", lambda sample: keys.add(str(sample.key_expr)))
        stamps, states, window, judged = set(), [], None, None
        while "stopped" not in states:
            assert time.monotonic() < began + PATIENCE
            states += [status["state"] for status in (client.status(0.0),) if status is not None]
            window = client.follow(0.05) or window
            judged = client.judged(0.0) or judged
            stamps |= set() if window is None else {window.stamp_ns}
        run.ended.wait(PATIENCE)
        took = time.monotonic() - began
        everything.undeclare()
    assert took > SECONDS / SPEED
    assert len(stamps) > 5
    assert window is not None
    assert judged is not None
    assert judged.stamp_ns == window.stamp_ns
    assert {"echogrid/v1/test/grid/fused/full", "echogrid/v1/test/tf"} <= keys
    assert any(key.startswith("0/echogrid/map/nav_msgs") for key in keys)  # ROS's names
    summary = replay(find_drive(drive, None), tmp_path / "file")
    assert run.summary["map_sha256"] == summary["map_sha256"]
    assert (tmp_path / "out" / "map.png").is_file()
    with np.load(tmp_path / "file" / "map.npz") as file:
        origin, log_odds, cell = file["origin"], file["log_odds"], float(file["cell"])
    row, column = (round(float(mine - theirs) / cell) for mine, theirs in zip(window.origin[::-1], origin[::-1], strict=True))
    inside = np.zeros(window.occupancy.shape, bool)
    top, left = max(row, 0), max(column, 0)
    cut = log_odds[top : row + 256, left : column + 256]
    inside[top - row : top - row + cut.shape[0], left - column : left - column + cut.shape[1]] = cut != 0
    known = window.occupancy >= 0
    assert not (known & ~inside).any()  # what was known once stays known; the last cycle ends after the last window
    assert known.sum() > 0.99 * inside.sum() > 1000


def test_it_can_be_stopped_before_there_is_a_map(endpoint: str, tmp_path: Path) -> None:
    drive = published_drive(tmp_path / "drive", endpoint, 20.0)
    command = [sys.executable, "-W", "error", "-m", "echogrid", "replay", "--publish", str(drive), "--out", str(tmp_path / "out"), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ) as program:
        assert program.stderr is not None
        while "publishing on" not in (line := program.stderr.readline()):
            assert line, "it ended"
        program.send_signal(signal.SIGTERM)
        said, logged = program.communicate(timeout=PATIENCE)
    assert (program.returncode, "Traceback" in logged) == (0, False), logged
    told = json.loads(said)
    assert told["not_to_be_trusted"] is not None
    assert told["drive_s"] < 2.0


def test_it_can_be_stopped_and_leaves_what_was_mapped(endpoint: str, tmp_path: Path) -> None:
    drive = published_drive(tmp_path / "drive", endpoint, 20.0)
    command = [sys.executable, "-W", "error", "-m", "echogrid", "replay", "--publish", str(drive), "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ) as program:
        with Client(endpoint, "test") as client:
            until(lambda: client.follow(0.1))
        program.send_signal(signal.SIGINT)
        said, logged = program.communicate(timeout=PATIENCE)
    assert program.returncode == 0, logged
    assert "Traceback" not in logged
    assert "map updates" in said
    assert 0 < json.loads((tmp_path / "out" / "summary.json").read_text())["drive_s"] < 20.0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--speed", "4"), "echogrid: --speed: needs --publish"),
        (("--foxglove", "8765"), "echogrid: --foxglove: needs --publish"),
        (("--publish", "--speed", "0"), "'0' is not a speed, expected a number from 0.01 to 1000"),
    ],
)
def test_options_that_do_not_fit_are_one_sentence(tmp_path: Path, arguments: tuple[str, ...], sentence: str) -> None:
    done = echogrid("replay", world.write_drive(tmp_path, []), *arguments)
    assert done.returncode in (1, 2)
    assert done.stderr.strip().endswith(sentence)


def test_a_recording_that_nothing_is_known_of_is_refused(endpoint: str, tmp_path: Path) -> None:
    drive = published_drive(tmp_path / "drive", endpoint, 1.0)
    text = (drive / "can.log").read_text()
    (drive / "can.log").write_text("".join(f"{line.replace(' 1', ' 7', 1).replace(' 3', ' 6', 1)}\n" for line in text.splitlines()))
    done = echogrid("replay", "--publish", drive, "--out", tmp_path / "out")
    assert done.returncode == 3
    assert "none of its" in done.stderr.splitlines()[-1]
    assert not (tmp_path / "out").exists()


def test_a_stored_map_begins_when_it_was_driven(endpoint: str, tmp_path: Path) -> None:
    """As in a replay that sends nothing: not when it was played."""
    drive = find_drive(published_drive(tmp_path / "drive", endpoint, 1.0), None)
    publish(drive, tmp_path / "sent", speed=100.0, store=tmp_path / "sent.egmap")
    replay(drive, tmp_path / "kept", store=tmp_path / "kept.egmap")
    begun = []
    for name in ("sent", "kept"):
        with TileStore(tmp_path / f"{name}.egmap") as store:
            begun += [epoch.description.begun_ns for epoch in store.epochs()]
    assert begun == [begun[0], begun[0]]
    assert begun[0] == pytest.approx(100e9, abs=1e9)


def test_a_line_that_is_no_frame_costs_no_other(endpoint: str, tmp_path: Path) -> None:
    drive = published_drive(tmp_path / "drive", endpoint, 1.0)
    text = (drive / "can.log").read_text()
    (drive / "can.log").write_text(text[:3000] + "\n" + text[3000:])
    with pytest.raises(EchogridError, match=r"could not be understood.*; the map of all else is in "):
        publish(find_drive(drive, None), tmp_path / "out", speed=100.0)
