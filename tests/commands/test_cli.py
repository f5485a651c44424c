"""What people expect at a prompt: near words, examples that can be typed, no colours where none are wanted, completion."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.support import world
from tests.support.places import DEMO, DOCS
from tests.support.program import echogrid
from tests.support.waiting import PATIENCE, until

from echogrid import cli
from echogrid.cli import _parser
from echogrid.commands.demo import WATCH
from echogrid.errors import EchogridError
from echogrid.maps.dense_map import write_npz
from echogrid.maps.picture import text
from echogrid_training import cli as training


@pytest.mark.parametrize(
    ("arguments", "guess"),
    [
        (("replya",), "did you mean 'replay'?"),
        (("help",), "did you mean '--help'?"),
        (("map", "exprot"), "did you mean 'export'?"),
        (("--log-level", "warn", "demo"), "did you mean 'warning'?"),
        (("map", "export", "a", "b", "--format", "pgn"), "did you mean 'png'?"),
        (("replay", "a", "--relatime"), "did you mean '--realtime'?"),
        (("replay", "a", "--modle", "paper"), "did you mean '--model'?"),  # and not the --mode of another command
        (("map", "export", "a", "b", "--modle", "raw"), "did you mean '--mode'?"),
    ],
)
def test_a_word_that_is_nearly_one_is_guessed(arguments: tuple[str, ...], guess: str) -> None:
    done = echogrid(*arguments)
    assert done.returncode == 2
    assert done.stderr.strip().endswith(guess)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("replay a.log b.log", "too many: b.log; echogrid replay takes one DRIVE_OR_LOG"),
        ("replay a.log b.log c.log -c e.toml", "too many: b.log c.log; echogrid replay takes one DRIVE_OR_LOG"),
        ("check a.log -c e.toml b.log", "too many: b.log; echogrid check takes one LOG"),
        ("init a.log b.dbc", "too many: b.dbc; echogrid init takes one LOG, a dbc file with --dbc"),
        ("replay a.log e.toml", "too many: e.toml; echogrid replay takes one DRIVE_OR_LOG, a config file with --config"),
        ("map export a.egmap b.png c.png", "too many: c.png; echogrid map export takes one FILE.egmap and one OUT"),
        ("run -c e.toml e.toml", "too many: e.toml; echogrid run takes options alone, a config file with --config"),
        ("run -c e.toml --log-level debug", "unrecognized arguments: --log-level debug: --log-level stands before the command"),
        ("--json status", "unrecognized arguments: --json: --json stands behind the command"),
    ],
)
def test_one_file_too_many_is_named_with_what_the_command_takes(capsys: pytest.CaptureFixture[str], arguments: str, said: str) -> None:
    with pytest.raises(SystemExit) as ended:
        _parser().parse_args(arguments.split())
    assert ended.value.code == 2
    assert capsys.readouterr().err.strip().endswith(f"error: {said}")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("replay a.log -c e.toml --out a.log", "a.log: is a file, expected a folder"),
        ("replay a.log -c e.toml --out a.log/out", "a.log/out: cannot be made: {folder}/a.log is a file"),
        ("replay e.toml -c a.log --out out", "a.log: is not valid TOML: "),
        ("check a.log -c .", ".: is a folder, expected a file such as e.toml"),
        ("check a.log -c e.toml --report none/a.html", "none/a.html: there is no folder none"),
        ("check a.log -c e.toml --report a.log", "a.log: is not written, expected a name that ends in .html"),
        ("check a.log -c e.toml --fix-out a.log", "a.log: is not written, expected a name that ends in .toml"),
        ("check a.log -c e.toml --fix-out folder.toml", "folder.toml: is a folder, expected the name of a file"),
        ("init a.log --out a.log --force", "a.log: is not written, expected a name that ends in .toml"),
        ("init a.log --out a.log/e.toml", "a.log/e.toml: there is no folder a.log"),
        ("map show out", "out: is a folder, expected a file such as out/map.yaml"),
        ("init a.log --dbc out", "out: is a folder, expected a file"),
    ],
)
def test_a_file_in_place_of_a_folder_or_of_another_is_said_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, said: str
) -> None:
    """The recording, which is none, would be complained about next."""
    monkeypatch.chdir(tmp_path)
    for name in ("out", "folder.toml"):
        (tmp_path / name).mkdir()
    (tmp_path / "out" / "map.yaml").touch()
    (tmp_path / "a.log").write_text("no frame\n")
    (tmp_path / "e.toml").write_text(world.CONFIG)
    given = _parser().parse_args(arguments.split())
    with pytest.raises(EchogridError) as refused:
        given.command(given)
    assert str(refused.value).startswith(said.format(folder=tmp_path))


def test_a_terminal_without_a_letter_gets_a_question_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a code page that has no such letter, and of a file's name that is none in UTF-8: an archive from another system."""
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    path = tmp_path / os.fsdecode(b"f\xfcr\xc3\xbc.toml")
    path.write_text(world.CONFIG)
    done = echogrid("check", "-c", path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{tmp_path}/f?r?.toml: 4 radars")


def test_a_word_that_is_near_nothing_is_not_guessed() -> None:
    assert "did you mean" not in echogrid("xyzzy").stderr


def test_a_model_that_is_nearly_one_is_guessed(tmp_path: Path) -> None:
    done = echogrid("replay", DEMO, "--model", "papr", "--out", tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("echogrid: --model: 'papr' found")
    assert done.stderr.strip().endswith("did you mean 'paper'?")


def test_training_guesses_too(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, guess in (
        (["simulat"], "simulate"),
        (["fit", "--drives", "x", "--out", "y", "--tset", "z"], "--test"),
        (["evaluate", "sm"], "sim"),
        (["simulate", "--family", "tset"], "test"),
    ):
        with pytest.raises(SystemExit, match="2"):
            training.main(arguments)
        assert capsys.readouterr().err.strip().endswith(f"did you mean '{guess}'?")


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


PARSERS = {"echogrid": cli._parser, "echogrid-train": training._parser}


def parsers(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """By the words that lead to them, all that take words of their own or none."""
    yield parser.prog.partition(" ")[2], parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from parsers(below)


@pytest.mark.parametrize(
    ("program", "example"),
    [(program, example) for program, made in PARSERS.items() for examples in made().examples.values() for example in examples],
)
def test_every_example_can_be_typed(program: str, example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "list.txt").write_text("monday.egmap\ntuesday.egmap\n")
    monkeypatch.chdir(tmp_path)
    command = example.partition(" | ")[0]
    assert PARSERS[program]().parse_args(shlex.split(command)).command is not None


@pytest.mark.parametrize("program", PARSERS)
def test_every_help_ends_with_examples_of_that_command(program: str) -> None:
    for command, parser in parsers(PARSERS[program]()):
        said = parser.format_help().partition("\nexamples:\n")[2].splitlines()
        assert said, command
        assert all(line.startswith(f"  {program} {command}".rstrip() + " ") or line == f"  {program} {command}" for line in said), command


def test_every_command_is_in_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        _parser().parse_args(["--help"])
    commands = re.findall(r"^    (\w+) ", capsys.readouterr().out, re.MULTILINE)
    assert set(commands) == {command for command, _ in parsers(_parser()) if command and " " not in command}
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


def test_ctrl_c_ends_the_demos_subscriber_without_a_word_while_it_is_loading(tmp_path: Path) -> None:
    """A terminal sends it to both processes."""
    command = [sys.executable, "-c", WATCH, "tcp/127.0.0.1:1", "car", str(tmp_path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as watcher:
        until(lambda: "numpy" in Path(f"/proc/{watcher.pid}/maps").read_text())
        watcher.send_signal(signal.SIGINT)
        _, said = watcher.communicate(timeout=PATIENCE)
    assert (watcher.returncode, said) == (-signal.SIGINT, "")


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_what_the_caller_closed_leads_nowhere(tmp_path: Path, closed: str) -> None:
    """And is not taken by the files that are opened next, which words would be written into."""
    (tmp_path / "e.toml").write_text(world.CONFIG)
    (tmp_path / "a.log").write_text("(1.0) can0 123#00\n")
    line = f"{sys.executable} -m echogrid replay {tmp_path}/a.log -c {tmp_path}/e.toml --out {tmp_path}/out {closed}"
    done = subprocess.run(["sh", "-c", line], timeout=PATIENCE, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (3, "")
    assert ("none of its 1 frames" in done.stderr) == ("2>" not in closed)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "words", [["replay", "a.log", "-c", "e.toml", "--out", ""], ["map", "info", ""], ["run", "-c", "e.toml", "--record", ""]]
)
def test_an_empty_word_is_not_the_working_folder(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    """As of `--out "$OUT"`, where OUT is not set: the files would lie wherever one is."""
    with pytest.raises(SystemExit, match="2"):
        _parser().parse_args(words)
    assert capsys.readouterr().err.endswith("an empty word found, expected a name: is a variable of the shell not set?\n")
