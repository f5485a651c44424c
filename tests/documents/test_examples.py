"""The programs that users start from do what they say: beside a drive that is published, on the shipped one, and by themselves."""

from __future__ import annotations

import ast
import importlib.util
import json
import re
import runpy
import shutil
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import can
import numpy as np
import pytest
from PIL import Image
from tests.support.documents import blocks
from tests.support.places import DEMO, DOCS, ROOT
from tests.support.playing import playing, published_drive
from tests.support.waiting import PATIENCE

from echogrid.client import MapName, Pose, Window
from echogrid.commands.replay import replay
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log

EXAMPLES = ROOT / "examples"
ENDPOINT = "tcp/127.0.0.1:7447"  # what they ask by themselves


def example(name: str) -> ModuleType:
    """As a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def begun(folder: Path, *words: str | Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-W", "error", *map(str, words)]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def told(program: subprocess.Popen[str]) -> list[str]:
    """What it printed, once it has ended well."""
    out, err = program.communicate(timeout=PATIENCE)
    assert (program.returncode, err) == (0, "")
    return out.splitlines()


def test_all_of_them_are_short_and_told_of() -> None:
    programs = sorted(path for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb"))
    assert len(programs) == 5
    readme = (EXAMPLES / "README.md").read_text()
    for path in programs:
        assert f"({path.name})" in readme
        lines = path.read_text().splitlines() if path.suffix == ".py" else "\n\n".join(cells(path)).splitlines()
        assert len(lines) < 60, path.name


class Run:
    """A program in a thread of its own; `said`: its lines."""

    def __init__(self, work: Callable[[Callable[..., None]], object]) -> None:
        self.said: list[str] = []
        self.thread = threading.Thread(target=work, args=(self._say,))
        self.thread.start()

    def _say(self, *words: object, **_: object) -> None:
        self.said.append(" ".join(map(str, words)))

    def end(self) -> list[str]:
        self.thread.join(PATIENCE)
        assert not self.thread.is_alive()
        return self.said


def test_subscribers_follow_a_drive_to_its_end(tmp_path: Path, endpoint: str) -> None:
    """The two examples, and the program in docs/interface.md: all three say what they saw, and end with the drive."""
    drive = published_drive(tmp_path / "drive", endpoint, 6.0, lost_after=3.0)
    (block,) = (block for block in blocks(DOCS / "interface.md") if block.language == "python")
    documented = compile(block.text.replace(ENDPOINT, endpoint).replace('vehicle="car"', 'vehicle="test"'), block.place, "exec")
    modules = [example(name) for name in ("nearest_obstacle", "watch_state")]

    def of(module: ModuleType) -> Callable[[Callable[..., None]], object]:
        def work(say: Callable[..., None]) -> None:
            vars(module)["print"] = say
            module.main(endpoint)

        return work

    runs = [Run(of(module)) for module in modules]
    with playing(drive, tmp_path / "out", 0.5, model="analytic") as played:
        runs.append(Run(lambda say: exec(documented, {"print": say})))
        assert played.ended.wait(PATIENCE)
    distances, verdicts, grids = (run.end() for run in runs)
    assert len(distances) > 3
    assert all(re.fullmatch(r"1\d\d\.\d\d s, +\d+\.\d m/s: (free|\d+\.\d m)", line) for line in distances)
    assert verdicts[0].startswith("stop")
    assert any(verdict.startswith("slow: radar front_right: silent") for verdict in verdicts)
    assert verdicts[-1].startswith("stop")
    assert len(grids) > 3
    assert all(re.fullmatch(r"\d+ \d+ occupied cells, 0\.\d\d on average", line) for line in grids)


@pytest.mark.parametrize(("x", "y", "yaw"), [(0.0, 0.0, 0.0), (5.0, -3.0, 0.7), (-2.0, 1.0, -2.5)])
def test_the_nearest_obstacle_is_as_far_as_it_is(x: float, y: float, yaw: float) -> None:
    """A thing 12 m ahead of the rear axle, one nearer but beside the way, one behind."""
    module, cell, half = example("nearest_obstacle"), 0.25, 80
    occupancy = np.zeros((2 * half, 2 * half), np.int8)
    for forward, left in ((12.0, 0.3), (8.0, 2.0), (-6.0, 0.0)):
        place = x + np.cos(yaw) * forward - np.sin(yaw) * left, y + np.sin(yaw) * forward + np.cos(yaw) * left
        column, row = (int(np.floor(part / cell)) + half for part in place)
        occupancy[row, column] = 90
    grid = Window(0, "odom", cell, (-half * cell, -half * cell), occupancy, MapName(b"", 0))
    assert module.ahead(grid, Pose(0, x, y, yaw, 0.0, 0.0)) == pytest.approx(12.0 - module.BUMPER, abs=cell)
    assert module.ahead(Window(0, "odom", cell, (0.0, 0.0), occupancy * 0, MapName(b"", 0)), Pose(0, x, y, yaw, 0.0, 0.0)) is None


@pytest.mark.parametrize("name", ["nearest_obstacle", "watch_state"])
def test_a_subscriber_ends_at_ctrl_c_without_a_word(name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def stopped(*_: object, **__: object) -> list[str]:
        raise KeyboardInterrupt

    monkeypatch.setattr("echogrid.client.vehicles", stopped)
    monkeypatch.setattr(sys, "argv", [f"{name}.py"])
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert capsys.readouterr() == ("", "")


ENDPOINTS = ("tcp", "foo/127.0.0.1:1", "tcp/127.0.0.1:99999", "tls/127.0.0.1:7447")
RECORDINGS = {  # what is typed, and how the sentence begins
    ("none",): "none: ",
    ("can.log",): "can.log: a log needs a configuration",
    ("can.log", "-c", "none.toml"): "none.toml: ",
    ("can.log", "-c", "wrong.toml"): "wrong.toml: line 2: ",
    ("can.log", "-c", str(DEMO / "echogrid.toml")): "can.log: no map came of it",
}


@pytest.mark.parametrize(
    ("name", "given", "begin"),
    [
        *((name, (one,), "endpoint: ") for name in ("nearest_obstacle", "watch_state") for one in ENDPOINTS),
        *(("map_of_a_recording", given, begin) for given, begin in RECORDINGS.items()),
    ],
)
def test_what_was_typed_wrong_is_one_sentence_that_names_it(
    name: str, given: tuple[str, ...], begin: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "can.log").write_text("(1.000000) can0 7FF#00\n")
    (tmp_path / "wrong.toml").write_text("[[bus]]\n[bus]\n")
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *given])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    said = ended.value.code
    assert isinstance(said, str)  # Python prints it and exits with 1
    assert said.startswith(begin)
    assert given[0] in said or "-c" in given
    assert "\n" not in said
    assert capsys.readouterr().out == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["can.log", "wrong.toml"]


@pytest.mark.parametrize("name", ["nearest_obstacle", "watch_state", "map_of_a_recording", "own_radar"])
def test_arguments_that_there_are_not_end_with_the_usage(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [f"{name}.py", "one", "more"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith(f"usage: {name}.py [-h]")


def test_nothing_is_acted_on_that_is_old_or_not_trusted() -> None:
    trust = example("watch_state").Trust()
    assert trust.verdict(0.0)[0] == "stop"
    trust.map_at = trust.status_at = 10.0
    for state, verdict in {"ok": "go", "degraded": "slow", "no_motion": "stop", "stale": "stop", "something new": "stop"}.items():
        trust.state, trust.reasons = state, ["why"]
        assert trust.verdict(10.1) == (verdict, "why")
    trust.state = "ok"
    assert trust.verdict(10.6)[0] == "stop"  # the map stopped
    trust.map_at = 13.0
    assert trust.verdict(13.1)[0] == "stop"  # the status did


@pytest.fixture(scope="module")
def beginning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first seconds of the shipped drive."""
    folder = tmp_path_factory.mktemp("drive")
    shutil.copy(DEMO / "echogrid.toml", folder)
    with can.CanutilsLogWriter(folder / "can.log") as writer:
        for count, message in enumerate(Log(find_drive(DEMO, None).log)):
            if count == 8000:
                break
            writer.on_message_received(message)
    return folder


def test_a_recording_becomes_arrays(beginning: Path, tmp_path: Path) -> None:
    """What it prints is what `replay` finds in the same recording."""
    lines = told(begun(tmp_path, EXAMPLES / "map_of_a_recording.py", beginning))
    summary = replay(find_drive(beginning, None), tmp_path / "out")
    metres, updates = map(int, re.findall(r"\d+", lines[0]))
    assert metres == pytest.approx(summary["distance_m"], abs=2.0)  # from update to update, not from sample to sample
    assert updates == pytest.approx(summary["cycles"], abs=1)  # the last one is no answer to a message
    with np.load(tmp_path / "recording.npz") as ours, np.load(tmp_path / "out" / "map.npz") as theirs:
        np.testing.assert_allclose(ours["origin"], theirs["origin"], atol=1e-6)
        known = theirs["log_odds"] != 0
        np.testing.assert_allclose(ours["probability"][known], 1 / (1 + np.exp(-theirs["log_odds"][known])), atol=1e-5)
        assert np.isnan(ours["probability"][~known]).all()


def test_a_profile_is_tried_and_what_is_wrong_with_it_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [line.split(":")[0] for line in told(begun(tmp_path, EXAMPLES / "own_radar.py"))] == ["range", "azimuth", "range_rate"]
    shutil.copytree(EXAMPLES / "owl", tmp_path / "owl")
    shutil.copy(EXAMPLES / "own_radar.py", tmp_path)
    profile = tmp_path / "owl" / "owl.toml"
    right = profile.read_text()
    monkeypatch.setattr(sys, "argv", ["own_radar.py"])
    for change, said in (
        (('unit = "deg", sign = -1', 'unit = "deg"'), "azimuth: are its unit and sign right in the profile?"),
        (("per_frame = 2", "per_frame = 1"), "0 scans came of the cycle, expected one: does the profile say how it begins and ends?"),
        (('"OwlHeader"', '"OwlHead"'), f"header.message: {profile.with_name('owl.dbc')} has no message 'OwlHead'"),
    ):
        profile.write_text(right.replace(*change))
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(tmp_path / "own_radar.py"), run_name="__main__")
        assert str(ended.value.code).endswith(said)
        assert "\n" not in str(ended.value.code)


def test_the_profile_in_the_document_is_that_of_the_example() -> None:
    documented, car = (block.text for block in blocks(DOCS / "your_radar.md") if block.language == "toml")
    assert tomllib.loads(documented) == tomllib.loads((EXAMPLES / "owl" / "owl.toml").read_text())
    assert tomllib.loads(car)["radar"] == tomllib.loads((EXAMPLES / "owl" / "echogrid.toml").read_text())["radar"]


def cells(notebook: Path) -> list[str]:
    """The source of its cells of code."""
    return ["".join(cell["source"]) for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]


def shown(notebook: Path) -> Iterator[Any]:
    """Runs its cells one after the other in one place; what each shows, the value of its last line, as Jupyter does."""
    place: dict[str, Any] = {}
    for number, source in enumerate(cells(notebook)):
        body = ast.parse(source).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), f"cell {number}", "exec"), place)
        yield eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), place) if isinstance(last, ast.Expr) else None


def test_the_notebook_shows_a_drive(
    beginning: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its cells in their order, with a shorter drive; kept without answers, so that a look at what changed is one at the program."""
    notebook = EXAMPLES / "look_at_a_drive.ipynb"
    document = json.loads(notebook.read_text())
    assert (document["nbformat"], document["nbformat_minor"]) == (4, 5)
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in document["cells"] if cell["cell_type"] == "code")
    assert len({cell["id"] for cell in document["cells"]}) == len(document["cells"])
    (tmp_path / notebook.name).write_text(
        notebook.read_text().replace('Path(str(files(\\"echogrid\\") / \\"demo_drive\\"))', f"Path('{beginning}')")
    )
    assert str(beginning) in (tmp_path / notebook.name).read_text()
    monkeypatch.chdir(tmp_path)
    _, state, picture, hits, _ = shown(tmp_path / notebook.name)
    assert state[1] == "ok"
    assert isinstance(picture, Image.Image)
    assert isinstance(hits, Image.Image)
    colours = np.asarray(picture.convert("L"))
    assert (colours < 40).any()
    assert (colours > 240).any()
    assert re.search(r"\d+ detections, of which \d+% stand still", capsys.readouterr().out)
