"""What a reader types is tried: every command of the documents is run, or is one at least, and it is said why it is not run.

A document says beside a block what is special about it: `<!-- not run: why -->`, of some of its lines `<!-- not run, `word`: why -->`. What
holds for a program wherever it is typed stands in NOT_RUN.
"""

from __future__ import annotations

import argparse
import gzip
import logging
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest
from tests.support.documents import DOCUMENTS, PROGRAMS, Block, blocks, tool
from tests.support.own_cars import CARS
from tests.support.places import ROOT
from tests.support.waiting import PATIENCE

from echogrid import cli as service
from echogrid_training import cli as training

NOT_RUN = {
    r"echogrid demo\b": "plays a whole drive: tests/release/test_packages.py",
    r"echogrid run\b": "opens CAN interfaces until it is stopped: tests/live, tests/rig",
    r"echogrid view\b": "serves until Ctrl-C: tests/viewing",
    r"echogrid status\b": "asks a running service: tests/commands/test_status.py",
    r"echogrid check .*--seconds": "listens to live buses: tests/commands/test_check_live.py",
    r"echogrid replay .*--publish": "plays at a recording's pace: tests/commands/test_publish.py",
    r"echogrid-train\b": "computes for minutes, or reads data sets that are not ours: tests/training",
    r"python examples/": "is run with what it needs: tests/documents/test_examples.py",
    r"make\b": "is what runs these tests; that its target is there is looked up",
    r"(pip install|python3 -m venv)\b": "tests install nothing; that an extra is there is looked up",
    r"dask\b": "wants a cluster: tests/maps/test_merge.py",
    r"source\b": "is for the shell of a person",
    r"(sudo|sudoedit|systemctl|networkctl|journalctl|ip|apt|candump|cd /usr)\b": "asks or changes the machine: tests/rig, in a guest",
}

SECONDS = 4.0  # of the drive, where any will do


def reason(block: Block, command: str) -> str | None:
    """Why it is not run; None where it is."""
    return block.why_not_run(command) or next((why for pattern, why in NOT_RUN.items() if re.match(pattern, bare(command))), None)


def bare(command: str) -> str:
    """Without the folder in which its program lies."""
    return re.sub(r"^\S*/", "", command)


@contextmanager
def as_program(*words: str) -> Iterator[None]:
    """What a program of ours may change of its process is as it was."""
    root, before = logging.getLogger(), sys.argv
    handlers, level, sys.argv = root.handlers[:], root.level, [*words]
    try:
        yield
    finally:
        root.handlers[:], sys.argv = handlers, before
        root.setLevel(level)


def echogrid(*arguments: str) -> int:
    """In this process: a program of its own takes a second to begin. Returns the exit code."""
    with as_program("echogrid", *arguments):
        try:
            service.main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0


@pytest.fixture(scope="module")
def stock(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What readers have: the recording of a car with a DBC of its own, its configuration, and maps of three epochs."""
    folder = tmp_path_factory.mktemp("stock")
    _, dbc, config = CARS["falcon"].write(folder, "drive.blf")
    shutil.copy(dbc, folder / "car.dbc")
    (folder / "echogrid.toml").write_text(f'model = "analytic"\n{config.read_text()}')
    config.unlink()
    shutil.copy(folder / "drive.blf", folder / "can.blf")
    with can.CanutilsLogWriter(folder / "can.log") as writer:
        for message in short(folder / "drive.blf"):
            writer.on_message_received(message)
    shutil.copy(folder / "can.log", folder / "drive.log")
    (folder / "can.log.gz").write_bytes(gzip.compress((folder / "can.log").read_bytes(), 1))
    words = ("can.log", "-c", "echogrid.toml", "--out", "out", "--store", "map.egmap")
    for _ in range(3):
        assert echogrid("replay", *(word if word.startswith("-") else str(folder / word) for word in words)) == 0
    for name in ("monday", "tuesday", "friday", "merged"):
        shutil.copy(folder / "map.egmap", folder / f"{name}.egmap")
    return folder


def short(recording: Path) -> Iterator[can.Message]:
    """The first SECONDS, with channels as candump names them."""
    with can.BLFReader(recording) as reader:
        first = None
        for message in reader:
            first = message.timestamp if first is None else first
            if message.timestamp > first + SECONDS:
                return
            message.channel = f"can{message.channel}"
            yield message


def lay_out(stock: Path, folder: Path, words: list[str]) -> list[str]:
    """Puts what a command names, and is not there yet, into the working folder; what lies under /etc/echogrid in a folder of it."""
    words = [word.replace("/etc/echogrid/", "") for word in words]
    for word in words:
        name = re.split("[@:]", word)[0] if ".egmap" in word else word
        if (stock / name).is_file() and not (folder / name).exists():
            shutil.copy(stock / name, folder / name)
            if name == "echogrid.toml":
                for beside in (*stock.glob("*.toml"), stock / "own.dbc"):
                    shutil.copy(beside, folder)
    return words


def run(command: str, stock: Path, folder: Path) -> int:
    words = shlex.split(command)
    if words[0] == "echogrid":
        return echogrid(*lay_out(stock, folder, words[1:]))
    path = f"{Path(sys.executable).parent}:/usr/bin:/bin"
    return subprocess.run(
        ["bash", "-ec", command], cwd=folder, env={"PATH": path}, capture_output=True, timeout=PATIENCE, check=False
    ).returncode


def parsed(words: list[str]) -> None:
    """Whether a program of ours takes these words. A summary of options is one of all of them, with the first of each choice."""
    parser: argparse.ArgumentParser = (service if words[0] == "echogrid" else training)._parser()
    summary = [re.sub(r"[\[\]]", "", word).split("|")[0] for word in words[1:] if word != "…"]
    given = ["1" if word == "N" else word.replace("DRIVE…", "drive").lstrip("@") for word in summary]  # @: no file is read for it
    assert callable(parser.parse_args(given).command)


def looked_up(command: str) -> None:
    """Whether what is not run could be: arguments, targets, extras, files."""
    words = shlex.split(command.split(" | ")[0])
    if words[0] in ("echogrid", "echogrid-train"):
        parsed(words)
    elif words[0] == "make":
        assert re.search(rf"(?m)^{words[1]}:", (ROOT / "Makefile").read_text()), f"no target {words[1]}"
    elif words[:2] == ["python", "-m"]:
        assert (ROOT / words[2].replace(".", "/")).with_suffix(".py").is_file() or (ROOT / words[2].replace(".", "/")).is_dir()
    elif words[0] == "python" and words[1].endswith(".py"):
        assert (ROOT / words[1]).is_file()
    for extra in re.findall(r"\[(\w+)\]'", command) if "pip install" in command else ():
        assert extra in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_command_does_what_it_says_or_is_one(
    document: Path, stock: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In the order of the document, so that what one leaves the next one finds. Programs in Python among them."""
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    for block in blocks(document):
        if block.language == "python":
            program = compile(block.text, block.place, "exec")
            if block.why_not_run(block.text) is None:
                lay_out(stock, tmp_path, re.findall(r"\w+\.egmap", block.text))
                exec(program, {})
        elif block.language == "toml":
            tomllib.loads(block.text)
        elif block.language == "sh":
            assert block.why_not_run(block.text), f"{block.place}: a script is run by a test of its own"
            continue
        for command in block.commands():
            assert tool(command) in PROGRAMS, f"{block.place}: {command}: what program is that?"
            if reason(block, command) is not None:
                looked_up(command)
                continue
            code = run(command, stock, tmp_path)
            assert code == 0, f"{block.place}: {command}: exit code {code}\n{capsys.readouterr()}"


def test_every_reason_is_one_of_something() -> None:
    """Of a command that is not run, and with a test that is there."""
    found = [(block, command) for document in DOCUMENTS for block in blocks(document) for command in block.commands()]
    for pattern in NOT_RUN:
        assert any(re.match(pattern, bare(command)) for _, command in found), pattern
    for block in (block for document in DOCUMENTS for block in blocks(document)):
        for word, _ in block.marks:
            assert word in block.text, f"{block.place}: not run is '{word}', which is not there"
    for why in (*NOT_RUN.values(), *(why for block, _ in found for _, why in block.marks)):
        for path in re.findall(r"tests/[\w/.]*\w", why):
            assert (ROOT / path).exists(), path


def test_most_of_what_the_service_does_is_run() -> None:
    """Else all could be called special."""
    run = {command.split()[1] for document in DOCUMENTS for block in blocks(document) for command in block.commands()
           if command.startswith("echogrid ") and reason(block, command) is None}  # fmt: skip
    assert run == {"init", "check", "replay", "map"}


def test_what_is_typed_within_a_sentence_is_there() -> None:
    """Commands, targets and modules in `code` of a line."""
    commands = set(re.findall(r"add_parser\(\s*\"(\w+)\"", Path(service.__file__).read_text()))
    for document in DOCUMENTS:
        for code in re.findall(r"`((?:echogrid|make|python -m) [^`\n]+)`", document.read_text("utf-8")):
            program, _, rest = code.partition(" ")
            for word in rest.split()[0].split("|") if program == "echogrid" else ():
                assert word in {*commands, "COMMAND"} or word.startswith("-"), f"{document.name}: {code}"
            if program == "python" and rest.startswith("-m tests"):
                looked_up(" ".join(code.split()[:3]))
            if program == "make" and re.fullmatch(r"[a-z-]+", rest.split()[0]):
                looked_up(f"make {rest.split()[0]}")
