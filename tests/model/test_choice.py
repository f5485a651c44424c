"""Which file of a shipped network runs, and what stands in where none is sound."""

from __future__ import annotations

import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest
from tests.support import networks
from tests.support.frames import CONFIG
from tests.support.networks import around, held, logits, write

from echogrid.config.loading import load_config
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.errors import EchogridError
from echogrid.model import choice as model_choice
from echogrid.model.choice import choose, choose_file, folder, measure, shipped, sums
from echogrid.model.network import OnnxSensorModel
from echogrid.model.sensor_model import SensorModel, sensor_model

SPEC = GridSpec(cells=16, cell=0.5)
EMPTY = np.zeros((networks.PLANES, 16, 16), np.uint8)
WRONG = [held(EMPTY, logits(EMPTY) + 1.0)]  # as a machine with other kernels would answer


def sha256(path: Path) -> str:
    """By coreutils."""
    return subprocess.run(["sha256sum", path], capture_output=True, text=True, check=True).stdout.split()[0]


def files(folder: Path, int8: object = None) -> list[Path]:
    """A network in int8 and in float; `int8`: other golden answers for the first."""
    change = {} if int8 is None else {"golden": int8}
    return [
        write(folder / "default.int8.onnx", *networks.default(precision="int8", **change)),
        write(folder / "default.onnx", *networks.default()),
    ]


@pytest.mark.parametrize("times", [(0.002, 0.005), (0.005, 0.0045), (0.005, 0.002)])
def test_the_first_sound_file_runs_unless_the_other_is_clearly_faster(
    tmp_path: Path, times: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tenth may be noise: a machine that chose anew at every start would not draw the same map twice."""
    monkeypatch.setattr(model_choice, "measure", lambda _: list(times))
    choice = choose_file(files(tmp_path), SPEC, {})
    name = "default.onnx" if times == (0.005, 0.002) else "default.int8.onnx"
    assert choice.model.path == tmp_path / name
    said = " ms, ".join(f"{path} {seconds * 1e3:.1f}" for path, seconds in zip(("default.int8.onnx", "default.onnx"), times, strict=True))
    assert choice.why == f"{name}, by {said} ms, SHA-256 {sha256(choice.model.path)}"


def test_a_file_that_answers_wrongly_here_gives_way_and_it_is_said(tmp_path: Path) -> None:
    choice = choose_file(files(tmp_path, int8=WRONG), SPEC, {})
    assert choice.model.path == tmp_path / "default.onnx"
    assert choice.model.contract.precision == "float"
    assert choice.why.startswith("default.onnx, by default.onnx ")
    assert choice.why.endswith(f"; {tmp_path / 'default.int8.onnx'}: golden answer 0 is off by 1, expected at most 0.05")


def test_where_no_file_is_sound_the_last_is_blamed(tmp_path: Path) -> None:
    int8, _ = files(tmp_path, int8=WRONG)
    with pytest.raises(EchogridError, match=r"none.onnx: cannot be read: No such file"):
        choose_file([int8, tmp_path / "none.onnx"], SPEC, {})


def test_each_file_is_run_as_often_as_the_other(tmp_path: Path) -> None:
    models = [choose_file([path], SPEC, {}).model for path in files(tmp_path)]
    models.append(choose(str(write(tmp_path / "paper.onnx", *networks.paper())), SPEC, {}).model)
    times = measure(models)
    assert len(times) == 3
    assert all(0 < seconds < 1 for seconds in times)


def test_int8_is_looked_for_first() -> None:
    assert [path.name for path in shipped("default")] == ["default.int8.onnx", "default.onnx"]
    assert [path.name for path in shipped("paper")] == ["paper.onnx"]


def test_a_path_is_taken_as_it_is(tmp_path: Path) -> None:
    path = write(tmp_path / "mine.onnx", *networks.paper())
    choice = choose(str(path), SPEC, {})
    assert (choice.model.path, choice.why) == (path, f"mine.onnx, as configured, SHA-256 {sha256(path)}")


def test_a_file_is_run_only_with_the_hash_that_the_configuration_gives(tmp_path: Path) -> None:
    path = write(tmp_path / "net.onnx", *networks.paper())
    right = sha256(path)
    assert configured(tmp_path, f'model = "net.onnx"\nmodel_sha256 = "{right}"').why.endswith(right)
    write(path, *networks.paper(calibration={"offset": 0.1}))  # as sound as before, but another
    with pytest.raises(EchogridError) as caught:
        configured(tmp_path, f'model = "net.onnx"\nmodel_sha256 = "{right}"')
    assert str(caught.value) == f"{tmp_path / 'echogrid.toml'}: model: {path}: has the SHA-256 {sha256(path)}, expected {right}"
    model = configured(tmp_path, f'model = "net.onnx"\nmodel_sha256 = "{right}"\nmodel_fallback = true')
    assert model.why.startswith(f"the analytic model, in place of 'net.onnx': {path}: has the SHA-256 ")


def test_a_shipped_file_that_was_exchanged_gives_way(tmp_path: Path) -> None:
    int8, exact = files(tmp_path)
    choice = choose_file([int8, exact], SPEC, {}, {int8.name: "0" * 64, exact.name: sha256(exact)})
    assert choice.model.path == exact
    assert choice.why.endswith(f"; {int8}: has the SHA-256 {sha256(int8)}, expected {'0' * 64}")
    with pytest.raises(EchogridError, match=r"default.onnx: has the SHA-256 \w+, expected one that SHA256SUMS lists"):
        choose_file([exact], SPEC, {}, {})


def test_the_list_of_hashes_is_that_of_the_shipped_files() -> None:
    assert sums() == {path.name: sha256(path) for path in folder().glob("*.onnx")}


def configured(folder: Path, text: str) -> SensorModel:
    path = folder / "echogrid.toml"
    path.write_text(CONFIG.replace('model = "analytic"', text) + "\n[grid]\ncells = 16\ncell = 0.5\n")
    return sensor_model(load_config(path), path)


def test_without_leave_to_fall_back_a_bad_model_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(EchogridError) as caught:
        configured(tmp_path, 'model = "none.onnx"')
    assert str(caught.value) == f"{tmp_path / 'echogrid.toml'}: model: {tmp_path / 'none.onnx'}: cannot be read: No such file or directory"


def test_with_leave_the_analytic_model_stands_in_and_says_so(tmp_path: Path) -> None:
    for change, complaint in (({"golden": WRONG}, "golden answer 0 is off by 1"), ({"cells": 32}, "was made for cells = 32")):
        write(tmp_path / "net.onnx", *networks.default(**change))
        model = configured(tmp_path, 'model = "net.onnx"\nmodel_fallback = true')
        assert isinstance(model.map, OccupancyMap)
        assert model.why.startswith(f"the analytic model, in place of 'net.onnx': {tmp_path / 'net.onnx'}: {complaint}")
        analytic = configured(tmp_path, 'model = "analytic"')
        np.testing.assert_array_equal(model.infer(around()), analytic.infer(around()))
        assert analytic.why == "the analytic model, as configured"


def test_the_file_says_which_map_it_is_for_and_the_configuration_may_say_otherwise(tmp_path: Path) -> None:
    """Looks: log-odds, weight and geometry. Sum: log-odds times weight, as the analytic model gives its own."""
    write(tmp_path / "net.onnx", *networks.default(calibration={"learned": 1.5, "offset": -0.3}))
    looks = configured(tmp_path, 'model = "net.onnx"')
    total = configured(tmp_path, 'model = "net.onnx"\nmap.fusion = "sum"')
    assert isinstance(looks.map, LookMap)
    assert isinstance(total.map, OccupancyMap)
    assert (looks.map.calibration.learned, looks.map.calibration.offset) == (1.5, -0.3)
    log_odds, weight = looks.infer(around())
    np.testing.assert_allclose(total.infer(around()), log_odds * weight, atol=1e-6)
    assert total.why == f"{looks.why}; summed as it answers: its calibration is for the rule 'looks'"
    write(tmp_path / "net.onnx", *networks.paper())
    plain = configured(tmp_path, 'model = "net.onnx"')
    assert isinstance(plain.map, OccupancyMap)
    assert "calibration" not in plain.why  # it has none to be left out
    assert isinstance(configured(tmp_path, 'model = "net.onnx"\nmap.fusion = "looks"').map, LookMap)


def test_the_shipped_files_are_sound_here_and_say_nearly_the_same() -> None:
    spec = GridSpec()
    exact, rounded = (OnnxSensorModel(folder() / f"default{kind}.onnx", spec, {}) for kind in ("", ".int8"))
    assert (exact.contract.precision, rounded.contract.precision) == ("float", "int8")
    assert exact.contract.calibration == rounded.contract.calibration
    golden = np.frombuffer(zlib.decompress(exact.contract.golden[0].image), np.uint8).reshape(networks.PLANES, 128, 128)
    (log_odds, weight), (near, near_weight) = exact.answer(golden), rounded.answer(golden)
    both = (weight > 0.5) & (near_weight > 0.5)
    assert both.sum() > 1000
    assert np.median(np.abs(near - log_odds)[both]) < 0.3
    assert np.abs(near_weight - weight).mean() < 0.02
