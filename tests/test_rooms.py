"""Rooms: an arrow between them runs downwards only, each says what it is for, and none grows into a telephone book."""

from __future__ import annotations

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.places import ROOT

MOST_FILES, MOST_LINES = 15, 330
PACKAGES = (ROOT / "service" / "echogrid", ROOT / "training" / "echogrid_training")
ROOMS = sorted({path.parent for package in PACKAGES for path in package.rglob("*.py")})


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    """The layers of pyproject.toml, over the packages in a folder."""
    code = f"import sys; sys.path[:0] = [{str(folder / 'service')!r}, {str(folder / 'training')!r}]; "
    code += f"from importlinter.cli import lint_imports_command; lint_imports_command([{str(folder / 'pyproject.toml')!r}, '--no-cache'])"
    return subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=300, check=False)


def test_arrows_run_downwards() -> None:
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("module", "line", "names"),
    [
        ("service/echogrid/core/mapper.py", "import echogrid.zenoh.publisher", ("echogrid.core", "echogrid.zenoh")),
        ("service/echogrid/core/motion/se2.py", "import echogrid.core.trust.watch", ("echogrid.core.motion", "echogrid.core.trust")),
        ("service/echogrid/can/decode.py", "def late():\n    import echogrid.live.service", ("echogrid.can", "echogrid.live")),
        ("service/echogrid/core/map/merge.py", "import threading", ("echogrid.core", "threading")),
        ("service/echogrid/errors.py", "import torch", ("echogrid", "torch")),
        ("training/echogrid_training/towns/town.py", "import echogrid_training.drives.drive", ("towns", "drives")),
    ],
)
def test_an_arrow_upwards_is_refused_with_the_names_of_both_rooms(tmp_path: Path, module: str, line: str, names: tuple[str, ...]) -> None:
    for package in PACKAGES:
        shutil.copytree(
            package, tmp_path / package.relative_to(ROOT), ignore=lambda _, names: [n for n in names if n.endswith(("onnx", "gz"))]
        )
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    with (tmp_path / module).open("a") as file:
        file.write(f"\n{line}\n")
    done = lint(tmp_path)
    assert done.returncode == 1
    assert all(name in done.stdout for name in ("BROKEN", *names))


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: str(room.relative_to(ROOT)))
def test_a_room_says_what_it_is_for_and_is_seen_at_a_glance(room: Path) -> None:
    files = sorted(room.glob("*.py"))
    assert ast.get_docstring(ast.parse((room / "__init__.py").read_text())), f"{room}/__init__.py has no sentence about the room"
    assert len(files) - 1 <= MOST_FILES, f"{room} has {len(files) - 1} files: split it"
    for path in files:
        lines = len(path.read_text().splitlines())
        assert lines <= MOST_LINES, f"{path} has {lines} lines: split it"
