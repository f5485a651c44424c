"""What a release is made of, and that it runs where nothing of this checkout is at hand."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest
from release.build import build, hatch, packages
from release.version import ReleaseError, debian, version
from tests.support.places import ROOT
from tests.support.waiting import PATIENCE


@pytest.fixture(scope="module")
def released(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The files by what follows the version in their names."""
    out = tmp_path_factory.mktemp("dist")
    number, sbom = version(), tmp_path_factory.mktemp("sbom") / "sbom.json"
    sbom.write_text("{}")
    (out / f"echogrid_{debian(number)}_any.deb").write_bytes(b"a package")
    (out / "echogrid_0.0.9_any.deb").write_bytes(b"of another version")
    try:
        files = build(out, sbom)
    except ReleaseError as error:
        if "C compiler" in str(error):
            pytest.skip(str(error))
        raise
    return {path.name.replace(debian(number), number).split(number, 1)[1] + path.name[8:9]: path for path in files}


@pytest.fixture(scope="module")
def compiled(released: dict[str, Path]) -> Path:
    return next(path for name, path in released.items() if name.startswith("-cp311-abi3-"))


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if ".dist-info/" not in name}


def test_everything_is_there_and_summed(released: dict[str, Path], compiled: Path) -> None:
    sums = released["-SHA256SUMS-"]
    told = dict(reversed(line.split("  ")) for line in sums.read_text().splitlines())
    assert told == {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in released.values() if path != sums}
    assert len(told) == 8  # sdist, two wheels and training's, requirements, changes, parts, Debian package: not the other version's
    assert released["-changes.md-"].read_text().startswith("## ")
    assert released["-requirements.txt-"].read_bytes() == (ROOT / "requirements" / "service.txt").read_bytes()
    with zipfile.ZipFile(next(path for path in released.values() if path.name.startswith("echogrid_training-"))) as archive:
        assert "echogrid_training/cli.py" in archive.namelist()


def test_wheels_hold_what_the_checkout_tracks_and_nothing_else(released: dict[str, Path], compiled: Path) -> None:
    """They were built from the sdist, so it lacks nothing either."""
    pure, fast = contents(released["-py3-none-any.whl-"]), contents(compiled)
    listed = subprocess.run(["git", "ls-files", "service/echogrid", "dbc"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip(f"git ls-files: {listed.stderr.strip()}")
    link = "service/echogrid/dbc"  # to the folder dbc
    tracked = {
        (f"echogrid/{name}" if name.startswith("dbc/") else name.removeprefix("service/")): name
        for name in listed.stdout.splitlines()
        if name != link
    }
    assert set(pure) == {name for name, path in tracked.items() if (ROOT / path).exists()}
    assert {name: pure[name] for name in pure} == {name: (ROOT / tracked[name]).read_bytes() for name in pure}
    assert set(fast) - set(pure) == {"echogrid/core/kernels/compiled.abi3.so"}
    assert pure.items() <= fast.items()


def test_the_same_checkout_gives_the_same_bytes(released: dict[str, Path], compiled: Path, tmp_path: Path) -> None:
    again = packages(tmp_path)
    assert [path.read_bytes() for path in again] == [
        released[".tar.gz-"].read_bytes(),
        released["-py3-none-any.whl-"].read_bytes(),
        compiled.read_bytes(),
    ]


def test_an_sdist_knows_its_version(released: dict[str, Path], tmp_path: Path) -> None:
    """Unpacked inside of another project's checkout, and built by the backend alone."""
    subprocess.run(["git", "init", "--quiet"], cwd=tmp_path, check=True)
    with tarfile.open(released[".tar.gz-"]) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = tmp_path.glob("echogrid-*")
    wheel = hatch(source, "wheel", tmp_path / "out", ECHOGRID_KERNELS="numpy")
    assert wheel.read_bytes() == released["-py3-none-any.whl-"].read_bytes()


def test_an_installed_wheel_runs_the_demo(compiled: Path, tmp_path: Path) -> None:
    """In an environment that has echogrid from the wheel alone, and what it needs from here."""
    home = tmp_path / "installed"
    venv.create(home, symlinks=True)
    python, place = home / "bin" / "python", Path(sysconfig.get_path("purelib", vars={"base": str(home)}))
    own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*map(str, command)], cwd=tmp_path, env=own, capture_output=True, text=True, timeout=4 * PATIENCE, check=False
        )

    done = run(sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-index", "--no-deps", compiled)
    assert done.returncode == 0, done.stderr
    # A line of a .pth file adds the folder alone: what is installed as editable there stays out.
    (place / "libraries.pth").write_text("\n".join(path for path in sys.path if path.endswith("-packages")) + "\n")
    assert run(python, "-c", "import echogrid; print(echogrid.__file__)").stdout.startswith(str(place))
    assert run(home / "bin" / "echogrid", "--version").stdout == f"echogrid {compiled.name.split('-')[1]}\n"
    done = run(home / "bin" / "echogrid", "demo", "--json")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary.pop("out") == "out/demo"
    assert summary == json.loads((tmp_path / "out" / "demo" / "summary.json").read_text())
    assert summary["cycles"] > 700
    assert summary["not_to_be_trusted"] is None
    assert "compiled" in summary["kernels"]
    assert (tmp_path / "out" / "demo" / "received.png").is_file()


def test_nobody_is_sent_to_an_index_that_does_not_have_it() -> None:
    texts = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    for folder, kind in (("docs", "md"), ("deploy", "md"), ("service", "py"), ("training", "py"), ("tests", "py")):
        texts += (ROOT / folder).rglob(f"*.{kind}")
    asked = re.compile(r"""(?:pip3?|pipx|uv)\s(?:.*\s)?install\s(?:.*\s)?['"]?echogrid(?:-training)?(?:\[|['"\s`]|$)""", re.MULTILINE)
    assert asked.search("pip install -U 'echogrid[view]'")
    assert not asked.search("pip install dist/echogrid-1.2.3-py3-none-any.whl")
    assert [
        str(path) for path in texts if path != Path(__file__) and asked.search(path.read_text(encoding="utf-8", errors="replace"))
    ] == []
