"""What a program has of a command: one JSON object on stdout, and an exit code of the table."""

from __future__ import annotations

import ast
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support import world
from tests.support.places import DOCS, ROOT
from tests.support.playing import published_drive
from tests.support.program import echogrid
from tests.support.waiting import PATIENCE

from echogrid.cli import _parser
from echogrid.errors import EchogridError, NoMapError


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return published_drive(tmp_path_factory.mktemp("drive"), "tcp/127.0.0.1:1", 3.0)


def test_a_replay_prints_its_summary_and_nothing_else(drive: Path, tmp_path: Path) -> None:
    done = echogrid("replay", drive, "--out", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told.pop("out") == str(tmp_path / "out")
    assert told == json.loads((tmp_path / "out" / "summary.json").read_text())
    assert told["cycles"] > 20


def test_changes_of_the_state_are_for_people_and_go_aside(tmp_path: Path) -> None:
    lost = published_drive(tmp_path / "drive", "tcp/127.0.0.1:1", 6.0, lost_after=3.0)
    loud, quiet = (echogrid("replay", lost, "--out", tmp_path / "out", *options) for options in ((), ("--json",)))
    change = next(line for line in loud.stdout.splitlines() if "degraded: radar front_right" in line)
    assert change in quiet.stderr.splitlines()
    assert json.loads(quiet.stdout)["worst_state"] == "degraded"


def test_published_too(endpoint: str, tmp_path: Path) -> None:
    done = echogrid("replay", published_drive(tmp_path / "drive", endpoint, 2.0), "--out", tmp_path / "out", "--publish", "--json")
    told = json.loads(done.stdout)
    assert done.returncode == (0 if told["not_to_be_trusted"] is None else 3)
    assert {"out": str(tmp_path / "out")} | json.loads((tmp_path / "out" / "summary.json").read_text()) == told


def test_a_configuration_alone(drive: Path) -> None:
    told = json.loads(echogrid("check", "-c", drive / "echogrid.toml", "--json").stdout)
    words = echogrid("check", "-c", drive / "echogrid.toml").stdout
    assert len(told["buses"]) == 1
    assert words.endswith(f"{len(told['radars'])} radars and ego motion on 1 bus, {told['ids']} ids are read\n")
    assert set(told["radars"]) == {"front_left", "front_right", "rear_left", "rear_right"}
    assert (told["log"], told["findings"]) == (None, [])


def test_a_first_configuration(drive: Path, tmp_path: Path) -> None:
    done = echogrid("init", next(drive.glob("can.*")), "--out", tmp_path / "new.toml", "--json")
    told = json.loads(done.stdout)
    assert done.returncode == (0 if told["accepted"] else 2)
    assert [Path(name).is_file() for name in told["files"]] == [True] * len(told["files"])
    assert {radar["profile"] for radar in told["radars"].values()} == {"corner_radar"}
    marked = sum("# uncertain: " in line for name in told["files"] for line in Path(name).read_text().splitlines())
    assert len(told["uncertain"]) == marked > 0


def test_whatever_prints_for_programs_is_in_the_table() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", (DOCS / "commands.md").read_text(), re.MULTILINE))
    (commands,) = (action.choices for action in _parser()._actions if action.choices is not None and isinstance(action.choices, dict))
    assert {name for name, row in rows.items() if "--json" in row} == {
        name for name, command in commands.items() if "--json" in command.format_help() or name == "map"
    }


# ---- exit codes ----

TABLE = {int(code) for code in re.findall(r"^\| (\d+) \|", (DOCS / "commands.md").read_text(), re.MULTILINE)}


def test_the_table_has_every_code_that_there_is() -> None:
    sources = [(ROOT / "service" / "echogrid" / name).read_text() for name in ("cli.py", "__main__.py")]
    calls = [node for source in sources for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    numbers = {
        node.value
        for call in calls
        if ast.unparse(call.func) == "sys.exit"
        for argument in call.args
        for node in ast.walk(argument)
        if isinstance(node, ast.Constant)
    }
    assert numbers | {EchogridError.exit_code, NoMapError.exit_code, 0} == TABLE
    assert {kind.exit_code for kind in EchogridError.__subclasses__()} <= TABLE


def test_each_code_is_what_the_table_says(drive: Path, tmp_path: Path) -> None:
    still = world.write_drive(tmp_path / "still", world.record(world.circle(6.0, 0.05), [], 0.05))
    for code, arguments in (
        (0, ("check", "-c", drive / "echogrid.toml")),
        (1, ("check", "-c", drive / "no.toml")),
        (2, ("chekc",)),
        (2, ("replay",)),
        (3, ("replay", still, "--out", tmp_path / "out")),
    ):
        done = echogrid(*arguments)
        assert done.returncode == code, done.stderr
        assert code in TABLE
        assert bool(done.stderr) == (code != 0)


@pytest.mark.parametrize(
    ("number", "options", "code"), [(signal.SIGINT, (), 130), (signal.SIGTERM, (), 130), (signal.SIGINT, ("--publish",), 0)]
)
def test_ctrl_c_and_sigterm_are_of_the_table_and_no_traceback(
    drive: Path, tmp_path: Path, number: signal.Signals, options: tuple[str, ...], code: int
) -> None:
    slow = "import time; from echogrid import __main__, cli; cli._replay = lambda given: (print('up', flush=True), time.sleep(600)); "
    command = [sys.executable, "-c", f"{slow}__main__.run()", "replay", str(drive), "--out", str(tmp_path), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "up\n"
        program.send_signal(number)
        _, logged = program.communicate(timeout=PATIENCE)
    assert (program.returncode, logged) == (code, "")
    assert code in TABLE


def test_a_reader_that_leaves_is_141_and_no_word(drive: Path) -> None:
    """As of `| head`."""
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as stdout:
        command = [sys.executable, "-m", "echogrid", "check", "-c", "echogrid.toml"]
        done = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, text=True, cwd=drive, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stderr) == (141, "")
