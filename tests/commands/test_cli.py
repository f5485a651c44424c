"""What people expect at a prompt: near words, examples that can be typed, no colours where none are wanted, completion."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.support.places import DOCS
from tests.support.program import echogrid
from tests.support.waiting import PATIENCE

from echogrid.arguments import EXAMPLES
from echogrid.cli import _parser
from echogrid.maps.dense_map import write_npz
from echogrid.maps.picture import text


@pytest.mark.parametrize(
    ("arguments", "guess"),
    [
        (("replya",), "did you mean 'replay'?"),
        (("map", "exprot"), "did you mean 'export'?"),
        (("--log-level", "warn", "demo"), "did you mean 'warning'?"),
        (("map", "export", "a", "b", "--format", "pgn"), "did you mean 'png'?"),
    ],
)
def test_a_word_that_is_nearly_one_is_guessed(arguments: tuple[str, ...], guess: str) -> None:
    done = echogrid(*arguments)
    assert done.returncode == 2
    assert done.stderr.strip().endswith(guess)


def test_a_word_that_is_near_nothing_is_not_guessed() -> None:
    assert "did you mean" not in echogrid("xyzzy").stderr


def test_files_that_are_nearly_there_are_guessed(tmp_path: Path) -> None:
    (tmp_path / "monday.blf").touch()
    (tmp_path / "car.toml").touch()
    (tmp_path / "all.egmap").touch()
    for arguments, name in (
        (("replay", tmp_path / "monda.blf", "-c", tmp_path / "car.toml"), "monday.blf"),
        (("replay", tmp_path / "monday.blf", "-c", tmp_path / "cat.toml"), "car.toml"),
        (("map", "info", tmp_path / "al.egmap"), "all.egmap"),
    ):
        done = echogrid(*arguments)
        assert done.returncode == 1
        assert done.stderr.strip().endswith(f"did you mean {tmp_path / name}?")
        assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("example", [example for examples in EXAMPLES.values() for example in examples])
def test_every_example_can_be_typed(example: str) -> None:
    command = example.partition(" | ")[0]
    assert _parser().parse_args(shlex.split(command)).command is not None


def test_every_command_has_examples_and_is_in_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        _parser().parse_args(["--help"])
    commands = re.findall(r"^    (\w+) ", capsys.readouterr().out, re.MULTILINE)
    assert set(commands) == set(EXAMPLES)
    rows = re.findall(r"^\| `(\w+)` \|", (DOCS / "commands.md").read_text(), re.MULTILINE)
    assert set(rows) == set(commands)


def test_without_colours_the_same_cells_are_there(tmp_path: Path) -> None:
    """In a pipe there are none; block for block it is what the coloured one shows."""
    log_odds = np.random.default_rng(0).choice(np.float32([-2, 0, 2]), (9, 30))
    write_npz(tmp_path / "map.npz", {"log_odds": log_odds, "origin": np.zeros(2), "cell": np.float64(0.25)})
    said = echogrid("map", "show", tmp_path / "map.npz").stdout
    assert "\x1b" not in said
    rows = np.pad(log_odds, ((0, 1), (0, 0)))[::-1]
    shown = [line.ljust(30) for line in text(log_odds, 100, coloured=False).splitlines()]
    for upper, lower, line in zip(rows[::2], rows[1::2], shown, strict=True):
        for u, v, mark in zip(upper > 0, lower > 0, line, strict=True):
            assert (mark in "█▀") == u
            assert (mark in "█▄") == v
    assert [line.rstrip() for line in said.splitlines()] == [line.rstrip() for line in shown]


def test_a_shell_is_told_how_a_line_goes_on(tmp_path: Path) -> None:
    pytest.importorskip("argcomplete")
    (tmp_path / "answer").touch()
    own = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "answer"),
        "COMP_TYPE": "9",
        "_ARGCOMPLETE_IFS": "\n",
    }
    line = "echogrid re"
    own |= {"COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARC_DEBUG": ""}
    subprocess.run([sys.executable, "-m", "echogrid"], env=own, timeout=PATIENCE, check=False, capture_output=True)
    assert (tmp_path / "answer").read_text().split() == ["replay"]
