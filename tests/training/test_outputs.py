"""What a command is to write is looked at before anything is read: hours may lie between the two."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import pytest

from echogrid_training import cli

WRITTEN = {"out", "json", "report", "into"}  # options that say where
FOLDERS = (  # with inputs that are nowhere, so that the sentence tells which was looked at first
    "import nuscenes nowhere --out",
    "import radarscenes nowhere --out",
    "import vod nowhere --frames 0-1 --out",
    "import kitti nowhere --out",
    "import own nowhere.log -c nowhere.toml --lidar nowhere --mount nowhere.toml --out",
    "scene --out",
    "demo --out",
    "simulate --family train --towns 1 --workers 1 --out",
    "inspect nowhere --out",
    "fit --drives nowhere --out",
    "reproduce --drives nowhere --test nowhere --out",
    "ablate --drives nowhere --test nowhere --out",
    "evaluate sim --test nowhere --calibrate nowhere --out",
    "evaluate real nuscenes nowhere --json new.json --out",
)
FILES = (
    "evaluate sim --test nowhere --calibrate nowhere --out new --json",
    "evaluate real nuscenes nowhere --json",
    "evaluate own nowhere --report",
    "evaluate own nowhere --json",
    "adapt default nowhere --calibrate-only --out",
    "report --nuscenes nowhere --radarscenes nowhere --astyx nowhere --kitti nowhere --into",
)
ENDS = {"--json": ".json", "--report": ".html", "--out": ".onnx", "--into": ".md"}


def leaves(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    below = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not below:
        yield parser
    for action in below:
        for one in action.choices.values():
            yield from leaves(one)


def test_every_command_that_writes_is_among_these() -> None:
    named = {parser.prog.partition(" ")[2]: parser for parser in leaves(cli._parser())}
    there = {(name, f"--{action.dest}") for name, parser in named.items() for action in parser._actions if action.dest in WRITTEN}
    assert {(name, line.split()[-1]) for line in (*FOLDERS, *FILES) for name in named if line.startswith(f"{name} ")} == there


@pytest.mark.parametrize("line", FOLDERS)
@pytest.mark.parametrize("below", [False, True], ids=["a file", "below a file"])
def test_a_folder_that_cannot_be_made_is_said_first(
    line: str, below: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("note").write_text("mine")
    out = "note/new" if below else "note"
    assert cli.main([*line.split(), out]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"{out}: ")
    assert said.endswith("a file, expected a folder\n" if not below else " is a file\n")
    assert said.count("\n") == 1
    assert Path("note").read_text() == "mine"


@pytest.mark.parametrize("line", FILES)
def test_a_file_where_a_folder_is_is_said_first(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    name = f"kept{ENDS[line.split()[-1]]}"
    Path(name).mkdir()
    assert cli.main([*line.split(), name]) == 1
    assert capsys.readouterr().err == f"{name}: is a folder, expected the name of a file\n"


@pytest.mark.parametrize("line", [line for line in FILES if not line.endswith("--into")])  # which is a page with marks
def test_a_recording_is_not_written_over(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("drive.log").write_text("mine")
    assert cli.main([*line.split(), "drive.log"]) == 1
    assert f"expected a name that ends in {ENDS[line.split()[-1]]}\n" in capsys.readouterr().err
    assert Path("drive.log").read_text() == "mine"
