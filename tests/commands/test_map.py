"""`echogrid map` as a program."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.program import echogrid
from tests.support.stores import content, three_epochs
from tests.support.waiting import PATIENCE

from echogrid.maps.info import info
from echogrid.maps.merge import Input, merge


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    return three_epochs(tmp_path / "car.egmap")


def test_the_commands_from_a_terminal(stored: Path, tmp_path: Path) -> None:
    done = echogrid("map", "info", "--json", stored)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout) == info(stored)
    done = echogrid("map", "export", stored, tmp_path / "cut.npz", "--epoch", "1", "--bbox=-1,-1,9.5,9.5")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{tmp_path / 'cut.npz'}: 42 x 42 cells of 0.25 m; not in it: ")
    done = echogrid("map", "show", tmp_path / "cut.npz")
    assert (done.returncode, done.stderr, "▀" in done.stdout) == (0, "", True)
    (tmp_path / "maps.txt").write_text(f"# two\n{stored}\n\n{stored}@3:2.5,0,0\n")
    done = echogrid("map", "merge", tmp_path / "merged.egmap", f"@{tmp_path / 'maps.txt'}")
    assert (done.returncode, done.stderr) == (0, "")
    merge([Input.parse(str(stored)), Input.parse(f"{stored}:2.5,0,0")], tmp_path / "again.egmap")
    assert content(tmp_path / "merged.egmap") == content(tmp_path / "again.egmap")
    done = echogrid("map", "merge", tmp_path / "merged.egmap", f"@{tmp_path / 'no.txt'}")
    assert done.stderr.endswith(f": error: {tmp_path / 'no.txt'}: cannot be read: No such file or directory\n")
    done = echogrid("map", "export", stored, tmp_path / "cut.npz")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"echogrid: {tmp_path / 'cut.npz'}: exists already: name another output, or give --force to replace it\n"


def test_without_the_extra_a_cluster_is_refused(stored: Path, tmp_path: Path) -> None:
    program = "import sys; sys.modules['distributed'] = None; from echogrid.cli import main; main()"
    command = [sys.executable, "-c", program, "map", "merge", tmp_path / "a.egmap", stored, "--scheduler", "tcp://127.0.0.1:9"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (done.returncode, done.stderr) == (1, "echogrid: --scheduler: distributed is not installed: pip install distributed\n")
