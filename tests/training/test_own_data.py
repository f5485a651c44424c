"""Every command of docs/own_data.md, run in the document's order on drives of a few seconds; the sizes alone are other ones.

What learns, and what reads other people's data sets, is looked up, and is tested elsewhere; here what `fit` cuts of labelled drives.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
from pathlib import Path

import pytest
from tests.support.documents import blocks
from tests.support.places import ROOT
from tests.training.labelling.test_odometry import write_bag

from echogrid_training import cli
from echogrid_training.learning.dataset import find_drives, load_drives
from echogrid_training.truth.simulated_truth import load_simulated_truth

DOCUMENT = ROOT / "docs" / "own_data.md"
COMMANDS = [command for block in blocks(DOCUMENT) for command in block.commands() if command.startswith("echogrid-train ")]
ELSEWHERE = {  # what is not run here, and where it is
    r"evaluate own ": "tests/training/own/test_evaluate_own.py",
    r"adapt default .* --calibrate-only": "tests/training/own/test_adapt.py",
    r"(simulate .* --like|adapt default .* --simulated) ": "tests/training/own/test_fine_tuning.py",
    r"fit --drives ": "tests/training/learning/test_fit.py",
    r"import nuscenes ": "tests/training/layouts/test_layouts.py",
    r"import (vod|kitti) ": "tests/training/layouts/test_layouts.py",
}
SMALLER = {  # one process: a second one loads for longer than it works
    "--seconds 60": "--seconds 5 --seed 5 --workers 1",
    "drives/tuesday --workers 2": "drives/tuesday --workers 1",
    "drives.txt --workers 2": "drives.txt --workers 1",
}


def elsewhere(command: str) -> str | None:
    return next((path for pattern, path in ELSEWHERE.items() if re.search(pattern, command)), None)


def test_a_reader_comes_from_a_bag_to_samples(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
    ran = []
    for command in COMMANDS:
        words = shlex.split(command.removeprefix("echogrid-train "))
        if elsewhere(command) is not None:
            assert callable(cli._parser().parse_args([word.replace("DRIVE…", "drive") for word in words]).command), command
            continue
        if "odometry.mcap" in words:
            true = load_simulated_truth(Path("cars/train-00000/truth.npz"))
            stamps = range(int(true.stamp_ns[0]), int(true.stamp_ns[-1]), 50_000_000)
            write_bag(Path("odometry.mcap"), [(stamp, pose) for stamp in stamps if (pose := true.pose(stamp)) is not None])
        if words[:2] == ["import", "many"]:
            shutil.copytree("drives/tuesday", "tuesday")
            shutil.rmtree("drives/tuesday")
            Path("drives.txt").write_text(others("tuesday", 1) + others("monday", 0))
        for size, small in SMALLER.items():
            command = command.replace(size, small)
        words = shlex.split(command.removeprefix("echogrid-train "))
        assert cli.main(words) == 0, f"{command}\n{capsys.readouterr()}"
        ran.append(" ".join(words[:2]))
    assert {"simulate --family", "import own", "import many"} <= set(ran)
    assert sum(words.startswith("label ") for words in ran) == 3
    samples = load_drives(find_drives(Path("drives")))
    assert len(samples) > 5
    assert (samples.labels > 0).any(axis=(1, 2)).all()
    assert (samples.labels < 0).any(axis=(1, 2)).all()
    posed = json.loads(Path("drives/posed/label.json").read_text())
    assert (posed["ground"], posed["poses"]) == ("followed", "odometry")
    for name in ("can.log.gz", "lidar.npz"):
        assert Path("drives/tuesday", name).read_bytes() == Path("tuesday", name).read_bytes()


def others(name: str, number: int) -> str:
    car = f"cars/train-{number:05d}"
    return f"own {car}/can.log.gz -c {car}/echogrid.toml --lidar {car}/lidar.mcap --mount {car}/lidar.toml --out drives/{name}\n"


def test_what_is_not_run_here_is_run_elsewhere() -> None:
    for pattern, path in ELSEWHERE.items():
        assert any(re.search(pattern, command) for command in COMMANDS), pattern
        assert (ROOT / path).is_file()
