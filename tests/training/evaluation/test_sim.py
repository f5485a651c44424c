"""`evaluate sim` from drives to tables and pictures, with two seeds of one network."""

from __future__ import annotations

import argparse
import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.support import candidates
from tests.support.networks import SHARES, default, write
from tests.support.rectangles import rectangles
from tests.support.tiny_towns import room, town, track

from echogrid.errors import EchogridError
from echogrid_training.drives.drive import write_drive
from echogrid_training.drives.simulate import simulate
from echogrid_training.evaluation import sim
from echogrid_training.evaluation.simulated import probes
from echogrid_training.evaluation.simulated.baselines import BASELINES
from echogrid_training.evaluation.simulated.patches import STRATA
from echogrid_training.evaluation.simulated.results import cleaned
from echogrid_training.evaluation.tables.markdown import markdown
from echogrid_training.evaluation.tables.table import number
from echogrid_training.learning.train import Settings, fit
from echogrid_training.sensors.episode import paper_like


def options(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    sim.add_arguments(parser)
    return parser.parse_args(list(arguments))


@pytest.fixture(scope="module")
def towns(room_drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A room to be judged by, in `test`; another to calibrate by, in `others`."""
    folder = tmp_path_factory.mktemp("towns")
    shutil.copytree(room_drive, folder / "others" / "room")
    recording, truth = simulate(town(*room(26.0, 12.0), ego=track(2.0, speed=4.0, x=-6.0), seed=5), paper_like(5))
    write_drive(recording, folder / "test" / "room-5", truth_map=truth)
    return folder


@pytest.fixture(scope="module")
def found(towns: Path, network_file: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp("out")
    graph, contract = default(128, 30.0 / 128)
    other = write(out / "other.onnx", graph, contract | {"class_shares": SHARES, "calibration": {"learned": 2.0}})
    settings = Settings("paper", epochs=1, width=2, batch=4, per_epoch=8, sensor="lidar")
    fit(rectangles(8, 1), rectangles(4, 2), settings, out / "lidar")
    models = ("--model", f"tiny={network_file}", "--model", f"tiny={other}", "--model", f"lidar={out / 'lidar' / 'model.pt'}")
    with pytest.MonkeyPatch.context() as patch:
        candidates.few(patch)
        patch.setattr(probes, "STANDING", 1)
        patch.setattr(probes, "STARTS", (0.3,))
        folders = ("--test", str(towns / "test"), "--calibrate", str(towns / "others"), "--out", str(out))
        said = sim.run(options(*folders, *models, "--workers", "1", "--patches", "4"))
    return said, out


def test_all_methods_are_judged_on_all_levels(found: tuple[str, Path]) -> None:
    results = json.loads((found[1] / "results.json").read_text())
    assert (results["drives"], results["towns"], results["calibration_drives"], results["patches"]) == (1, 1, 1, 4)
    assert set(results["levels"]["patch"]) == {"mean patch", "tiny", "lidar", *BASELINES}
    maps = {"Elfes, sum", "Elfes, sum, tuned", "geometric layer of looks"}
    maps |= {f"tiny, {rule}" for rule in ("looks", "sum", "sum without clamp", "learned layer of looks")}
    for level in ("around", "finished", "revisited", "after 1 looks"):
        assert set(results["levels"][level]) == maps
    for row in results["levels"]["finished"].values():
        assert row["mse_free"] is not None
    for row in results["levels"]["patch"].values():
        assert set(row["strata"]) == set(STRATA)
        np.testing.assert_allclose(row["interval"]["ap"], row["ap"], atol=1e-9)  # one town alone
    assert results["levels"]["patch"]["Elfes, 15 m"]["ap"] > 2 * results["levels"]["patch"]["all unknown"]["ap"]


def test_the_same_network_twice_is_one_row_without_deviation(found: tuple[str, Path]) -> None:
    """Its files differ in how maps are read out, which single answers do not hang on."""
    results = json.loads((found[1] / "results.json").read_text())
    assert results["levels"]["patch"]["tiny"]["sd"]["ap"] == 0.0
    assert results["levels"]["finished"]["tiny, looks"]["sd"]["published_nll"] > 0.0
    assert len(results["models"]["tiny"]) == 2


def test_tables_and_pictures(found: tuple[str, Path]) -> None:
    said, out = found
    assert (out / "results.md").read_text() == said
    for name in ("Single map updates", "by visibility", "The finished map", "cold start", "Standing", "± 0.000"):
        assert name in said
    widths = {line.count(" |") for line in said.split("### Single map updates\n\n")[1].split("\n\n")[0].splitlines()}
    assert len(widths) == 1  # every row has all columns
    for name in ("patch-room-5", "finished-room-5", "reliability-patch", "reliability-around", "reliability-finished"):
        with Image.open(out / f"{name}.png") as picture:
            assert min(picture.size) > 400


def test_maps_alone_say_the_same_of_maps(
    found: tuple[str, Path], towns: Path, network_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With one network of two, and from the same drives: nothing hangs on patches."""
    candidates.few(monkeypatch)
    folders = ("--test", str(towns / "test"), "--calibrate", str(towns / "others"), "--out", str(tmp_path))
    said = sim.run(options(*folders, "--model", f"tiny={network_file}", "--workers", "1", "--maps"))
    results, whole = (json.loads((folder / "results.json").read_text()) for folder in (tmp_path, found[1]))
    assert set(results["levels"]) == {"around", "finished"}
    assert (results["patches"], results["standstill"], results["revisit"]) == (0, {}, {})
    for name in ("Elfes, sum", "geometric layer of looks"):
        for figure in ("sure", "published_nll", "mse_occupied", "said"):
            assert results["levels"]["finished"][name][figure] == whole["levels"]["finished"][name][figure]
    assert "tiny, sum without clamp" in said
    assert "Single map updates" not in said
    assert not list(tmp_path.glob("patch-*.png"))
    with pytest.raises(EchogridError, match="--maps and --sweep found together, expected one of them"):
        sim.run(options(*folders, "--maps", "--sweep"))


def test_work_is_spread_in_order() -> None:
    calls = [(3.0, 4.0), (5.0, 12.0), (8.0, 15.0)]
    for workers in (1, 2):
        with sim.spread(workers, lambda things, _: things) as each:
            assert each(math.hypot, calls, "working") == [5.0, 13.0, 17.0]


def test_drives_on_both_sides_are_refused(towns: Path, tmp_path: Path) -> None:
    shutil.copytree(towns / "test" / "room-5", tmp_path / "copied" / "other-name")
    with pytest.raises(EchogridError, match=r"other-name: is the test drive .*room-5, expected calibration drives"):
        sim.run(options("--test", str(towns / "test"), "--calibrate", str(tmp_path / "copied"), "--out", str(tmp_path / "out")))


def test_a_file_that_does_not_say_its_classes_is_refused(towns: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "bare.onnx", *default(128, 30.0 / 128))
    arguments = ("--test", str(towns / "test"), "--calibrate", str(towns / "others"), "--model", f"bare={path}", "--workers", "1")
    with pytest.raises(EchogridError, match=r"bare\.onnx: metadata 'echogrid' does not say the class_shares"):
        sim.run(options(*arguments, "--out", str(tmp_path / "out")))


def test_models_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert sim.named("a=b=c.onnx") == ("a", Path("b=c.onnx"))
    with pytest.raises(SystemExit):
        options("--test", "a", "--calibrate", "b", "--out", "c", "--model", "default")
    assert "'default' found, expected NAME=FILE.onnx or NAME=FILE.pt" in capsys.readouterr().err


def test_what_has_no_meaning_is_a_dash() -> None:
    assert number(None) == "–"
    assert markdown(("a", "b"), [("x", number(0.12345))]).splitlines() == ["| a | b |", "| --- | ---: |", "| x | 0.123 |"]
    assert cleaned({"a": [math.nan, (1.0, math.inf)], "b": "c"}) == {"a": [None, [1.0, None]], "b": "c"}
