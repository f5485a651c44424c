"""Many drives at once: each a task, restartable, the same bits wherever it was done."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from echogrid_training import cli
from echogrid_training.labelling.bring import read_turns, write_turns
from echogrid_training.labelling.clouds import Cloud

RESULTS = ("truth.npz", "label.png", "label.json")
LABEL = "import sys; from echogrid_training.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture
def drives(labelled: Path, tmp_path: Path) -> Path:
    """Three drives of a second or two, not yet labelled."""
    turns = read_turns(labelled)
    for number, count in enumerate((12, 16, 20)):
        folder = tmp_path / "drives" / f"drive-{number}"
        shutil.copytree(labelled, folder, ignore=shutil.ignore_patterns(*RESULTS))
        write_turns(folder / "lidar.npz", [Cloud(one.stamp_ns, one.cloud().points[::4]) for one in turns[40 : 40 + count]])
    return tmp_path / "drives"


def found(drives: Path) -> dict[str, bytes]:
    return {str(path.relative_to(drives)): path.read_bytes() for name in RESULTS for path in drives.glob(f"*/{name}")}


def label(drives: Path, *more: str) -> int:
    return cli.main(["label", *map(str, sorted(drives.iterdir())), *more])


def test_one_worker_two_and_a_cluster_write_the_same(drives: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    for name in ("two", "cluster"):
        shutil.copytree(drives, tmp_path / name)
    assert label(drives, "--workers", "1") == 0
    here = found(drives)
    assert len(here) == 9
    assert label(tmp_path / "two", "--workers", "2") == 0
    assert found(tmp_path / "two") == here
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1", dashboard_address=None
    ) as cluster:
        assert label(tmp_path / "cluster", "--scheduler", cluster.scheduler_address) == 0
    assert found(tmp_path / "cluster") == here


def test_a_run_that_was_killed_goes_on(drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Killed once the first drive is done; then another is torn by hand. What was done is not touched."""
    shutil.copytree(drives, tmp_path / "whole")
    assert label(tmp_path / "whole", "--workers", "1") == 0
    arguments = ["label", *map(str, sorted(drives.iterdir())), "--workers", "1"]
    with subprocess.Popen([sys.executable, "-c", LABEL, *arguments], stdout=subprocess.DEVNULL) as process:
        first = drives / "drive-0" / "truth.npz"
        for _ in range(1200):
            if first.exists():
                break
            time.sleep(0.05)
        process.kill()
    assert first.exists()
    done = first.stat().st_mtime_ns
    assert label(drives, "--workers", "1") == 0
    assert first.stat().st_mtime_ns == done
    assert "drive-0/truth.npz: is done already" in capsys.readouterr().out
    assert found(drives) == found(tmp_path / "whole")
    torn = drives / "drive-1" / "truth.npz"
    torn.write_bytes(torn.read_bytes()[:5000])
    assert label(drives, "--workers", "1") == 0
    assert found(drives) == found(tmp_path / "whole")
    assert not list(drives.rglob("*.partial*"))


def test_one_that_fails_stops_no_other_and_is_named(drives: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (drives / "drive-1" / "lidar.toml").write_text("x = 1\n")
    assert label(drives, "--workers", "2") == 1
    said = capsys.readouterr().err
    assert said.splitlines()[-1].startswith("1 of 3 failed: ")  # before it how many are done, on a busy machine
    assert "drive-1/lidar.toml: the key 'y' is missing" in said
    assert sorted(path.parent.name for path in drives.glob("*/truth.npz")) == ["drive-0", "drive-2"]


def test_a_truth_of_something_else_is_neither_kept_nor_replaced(drives: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = drives / "drive-0"
    assert cli.main(["label", str(drive)]) == 0
    assert cli.main(["label", str(drive), "--ground", "followed"]) == 1
    assert "truth.npz: was made of other files or another --ground; give --force" in capsys.readouterr().err
    assert cli.main(["label", str(drive), "--ground", "followed", "--force"]) == 0
    assert json.loads((drive / "label.json").read_text())["ground"] == "followed"
    (drive / "label.json").unlink()
    assert cli.main(["label", str(drive)]) == 1
    assert "truth.npz: is there already, and not by this command; give --force" in capsys.readouterr().err
    with np.load(drive / "truth.npz") as held:
        assert len(held["stamp_ns"]) == 12


def test_a_cluster_that_is_not_there_is_one_sentence(
    drives: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("echogrid.maps.cluster.PATIENCE", 0.2)
    assert label(drives, "--scheduler", "tcp://127.0.0.1:9") == 1
    assert capsys.readouterr().err.startswith("tcp://127.0.0.1:9: no Dask scheduler answers there within 0.2 s: ")
