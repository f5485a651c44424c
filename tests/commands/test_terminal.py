"""What is shown on a terminal, and what a log has in its place."""

from __future__ import annotations

import logging
import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.support.waiting import PATIENCE

from echogrid.commands import terminal
from echogrid.maps.dense_map import write_npz

MAP = "from pathlib import Path; from echogrid.commands.terminal import show_map; show_map(Path('.'))"
BAR = (
    "import time; from echogrid.commands.terminal import progress\n"
    "with progress('reading all of it') as advance:\n"
    "    for n in range(5): advance(n / 4); time.sleep(0.2)\n"
)


def on_a_terminal(code: str, folder: Path, **own: str) -> str:
    """What a program writes whose stdout and stderr are a terminal of 80 columns."""
    ours, theirs = pty.openpty()
    environment = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    environment |= {"TERM": "xterm-256color", "COLUMNS": "80"} | own
    with subprocess.Popen([sys.executable, "-c", code], cwd=folder, env=environment, stdin=theirs, stdout=theirs, stderr=theirs) as program:
        os.close(theirs)
        data = b""
        while True:
            try:
                part = os.read(ours, 1 << 16)
            except OSError:  # Linux says so when the other end is closed
                break
            if not part:
                break
            data += part
        program.wait(PATIENCE)
    os.close(ours)
    assert program.returncode == 0, data
    return data.decode()


def test_a_map_is_drawn_with_the_colours_that_are_wanted(tmp_path: Path) -> None:
    log_odds = np.random.default_rng(0).choice(np.float32([-2, 0, 2]), (20, 30))
    write_npz(tmp_path / "map.npz", {"log_odds": log_odds, "origin": np.zeros(2), "cell": np.float64(0.25)})
    coloured = on_a_terminal(MAP, tmp_path)
    assert "\x1b[" in coloured
    assert "▀" in coloured
    for own in ({"NO_COLOR": "1"}, {"TERM": "dumb"}):
        plain = on_a_terminal(MAP, tmp_path, **own)
        assert "\x1b" not in plain
        assert set(plain.split()[0]) <= set("█▀▄░▒▓ ·.")
    piped = subprocess.run([sys.executable, "-c", MAP], cwd=tmp_path, capture_output=True, timeout=PATIENCE, check=True)
    assert piped.stdout == b""  # a replay's; `map show` draws it there too: test_cli.py


def test_a_bar_is_on_a_terminal_alone(tmp_path: Path) -> None:
    pytest.importorskip("rich")
    shown = on_a_terminal(BAR, tmp_path)
    assert "reading all of it" in shown
    assert "50%" in shown
    piped = subprocess.run([sys.executable, "-c", BAR], cwd=tmp_path, capture_output=True, timeout=PATIENCE, check=True)
    assert (piped.stdout, piped.stderr) == (b"", b"")


def test_what_takes_long_says_so_in_the_log_now_and_then(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    now = 0.0
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now)
    caplog.set_level(logging.INFO, "echogrid")
    with terminal.progress("reading a.blf") as advance:
        for now in np.arange(0.0, 25.0, 0.5):
            advance(now / 25)
    assert [record.getMessage() for record in caplog.records] == ["reading a.blf: 8%", "reading a.blf: 48%", "reading a.blf: 88%"]
