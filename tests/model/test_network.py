"""Model files: small networks made by hand, and every way in which a file is not what it should be."""

from __future__ import annotations

import base64
import os
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from tests.support import networks
from tests.support.networks import CLASSES, PLANES, around, held, logits, write
from tests.support.waiting import PATIENCE

from echogrid.core.evidence.history_raster import CHANNELS, HistoryRaster
from echogrid.core.evidence.raster import GridSpec, rasterize
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.errors import EchogridError
from echogrid.model.network import OnnxSensorModel, coarse, folded, unfolded

SPEC = GridSpec(cells=16, cell=0.5)
MOUNTS = {"front_left": Mount(SE2(1.0, 0.0, 0.0), 1.2, 10.0)}
Made = Callable[..., tuple[onnx.GraphProto, dict[str, Any]]]


def read(path: Path) -> OnnxSensorModel:
    return OnnxSensorModel(path, SPEC, MOUNTS)


def image(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (PLANES, 16, 16)).astype(np.uint8)


def test_the_papers_network_is_shown_the_newest_detections(tmp_path: Path) -> None:
    model = read(write(tmp_path / "net.onnx", *networks.paper()))
    drawn = model.draw(around())
    np.testing.assert_array_equal(np.where(drawn > 0, 1.0, -1.0), rasterize(around().now.points, SPEC))
    log_odds, weight = model(around())
    np.testing.assert_allclose(log_odds, 3.0 * rasterize(around().now.points, SPEC)[0] + 0.5, atol=1e-6)
    assert (weight == 1).all()


def test_the_default_network_is_shown_all_planes_as_bytes(tmp_path: Path) -> None:
    model = read(write(tmp_path / "net.onnx", *networks.default()))
    np.testing.assert_array_equal(model.draw(around()), HistoryRaster(SPEC, MOUNTS)(around()))
    for seed in range(3):
        np.testing.assert_allclose(model.run(image(seed)), logits(image(seed)), atol=1e-4)
    log_odds, weight = model(around())
    assert log_odds.shape == weight.shape == (16, 16)
    assert log_odds.dtype == weight.dtype == np.float32


def test_log_odds_are_of_occupied_among_the_observable_and_the_weight_is_how_likely_that_is(tmp_path: Path) -> None:
    """The softmax of three logits, term by term."""
    model = read(write(tmp_path / "net.onnx", *networks.default()))
    log_odds, weight = model.answer(image(5))
    free, unknown, occupied = np.exp(logits(image(5)))
    total = free + unknown + occupied
    np.testing.assert_allclose(weight, 1 - unknown / total, rtol=1e-4)
    np.testing.assert_allclose(1 / (1 + np.exp(-log_odds)), occupied / (free + occupied), rtol=1e-4)


def test_weights_stay_numbers_where_logits_are_huge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = read(write(tmp_path / "net.onnx", *networks.default()))
    huge = np.array([(1e4, -1e4, 0.0), (-1e4, 1e4, 0.0), (0.0, 0.0, 0.0), (-1e4, -1e4, 1e4)], dtype=np.float32).T  # four cells, folded
    monkeypatch.setattr(model, "_output", lambda _: huge.reshape(1, 12, 1, 1))
    log_odds, weight = model.answer(np.zeros((12, 2, 2), np.uint8)).reshape(2, 4)
    np.testing.assert_allclose(weight, [1.0, 0.0, 2 / 3, 1.0], atol=1e-6)
    assert log_odds.tolist() == [-1e4, 1e4, 0.0, 2e4]


def test_folding_moves_each_cell_of_a_block_into_a_channel() -> None:
    """By its definition, cell by cell; and back."""
    whole = image(4)
    found = folded(whole)
    assert found.shape == (4 * PLANES, 8, 8)
    for c, i, j in np.ndindex(PLANES, 16, 16):
        assert found[4 * c + 2 * (i % 2) + j % 2, i // 2, j // 2] == whole[c, i, j]
    np.testing.assert_array_equal(unfolded(found.astype(np.float32)), whole)


def test_coarse_is_the_mean_of_a_block() -> None:
    planes = np.random.default_rng(1).normal(size=(3, 16, 24)).astype(np.float32)
    means = coarse(planes)
    assert means.shape == (3, 2, 3)
    for p, i, j in np.ndindex(3, 2, 3):
        assert means[p, i, j] == pytest.approx(planes[p, 8 * i : 8 * i + 8, 8 * j : 8 * j + 8].mean(), abs=1e-6)


EMPTY = np.zeros((1, 16, 16), np.uint8)
SAID = np.full((1, 16, 16), -2.5)  # what the paper's network says to it
OFF = SAID.copy()
OFF[0, 8:, 8:] = 3.0


def packed(content: bytes) -> dict[str, str]:
    return held(EMPTY, SAID) | {"image": base64.b64encode(content).decode()}


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"version": 1}, "was made for version = 1, expected 2"),
        ({"cells": 32}, "was made for cells = 32, expected 16"),
        ({"cell": 0.25}, "was made for cell = 0.25 m, expected 0.5 m"),
        ({"channels": ["detections", "rcs"]}, "was made for channels = ('detections', 'rcs'), expected ('detections',) or ('now', "),
        ({"channels": list(CHANNELS[:-1])}, "was made for channels = ('now', "),
        ({"channels": list(CHANNELS)}, "takes a tensor(float) of shape [1, 1, 16, 16], expected a tensor(uint8) of shape [1, 48, 8, 8]"),
        ({"output": "class-logits"}, "gives a tensor(float) of shape [1, 16, 16], expected a tensor(float) of shape [1, 12, 8, 8]"),
        ({"output": "probability"}, "metadata 'echogrid': Invalid enum value 'probability' - at `$.output`"),
        ({"precision": "int4"}, "metadata 'echogrid': Invalid enum value 'int4'"),
        ({"fusion": "max"}, "metadata 'echogrid': Invalid enum value 'max'"),
        ({"calibration": {"learned": "much"}}, "metadata 'echogrid': Expected `float`, got `str` - at `$.calibration.learned`"),
        ({"golden": []}, "holds no golden answers"),
        ({"golden": [held(EMPTY, OFF)]}, "golden answer 0 is off by 5.5, expected at most 0.001"),
        ({"golden": [held(EMPTY, SAID), held(EMPTY, SAID + 0.01)]}, "golden answer 1 is off by 0.01, expected at most 0.001"),
        ({"golden": [held(EMPTY, np.full_like(SAID, np.nan))]}, "golden answer 0 is off by nan"),
        ({"golden": [held(EMPTY[:, :8], SAID)]}, "golden answer 0 is not of 1 x 2 x 2 blocks for an image (1, 16, 16)"),
        ({"golden": [held(EMPTY, SAID[:, :8, :8])]}, "golden answer 0 is not of 1 x 2 x 2 blocks"),
        ({"golden": [packed(b"not packed")]}, "golden answer 0 is not a packed image: "),
        ({"golden": [packed(zlib.compress(bytes(1 << 24)))]}, "golden answer 0 is not of 1 x 2 x 2 blocks"),  # a bomb
        ({"golden": [packed(zlib.compress(EMPTY.tobytes())[:-6])]}, "golden answer 0"),
        ({"golden": [{"image": "?", "coarse": ""}]}, "metadata 'echogrid': "),
        ({"golden": [{"image": ""}]}, "metadata 'echogrid': Object missing required field `coarse`"),
    ],
)
def test_a_model_that_was_made_for_something_else_is_refused(tmp_path: Path, change: dict[str, Any], complaint: str) -> None:
    assert complaint in refused(write(tmp_path / "net.onnx", *networks.paper(**change)))


def refused(path: Path) -> str:
    """One sentence that names the file."""
    with pytest.raises(EchogridError) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    return str(caught.value)


def test_how_far_a_golden_answer_may_be_off_hangs_on_the_precision(tmp_path: Path) -> None:
    """Machines round int8 differently by more than float."""
    whole = image(1)
    near = [held(whole, logits(whole) + 0.03)]
    assert "golden answer 0 is off by 0.03" in refused(write(tmp_path / "float.onnx", *networks.default(golden=near)))
    read(write(tmp_path / "int8.onnx", *networks.default(golden=near, precision="int8")))
    far = [held(whole, logits(whole) + 0.1)]
    complaint = refused(write(tmp_path / "far.onnx", *networks.default(golden=far, precision="int8")))
    assert "golden answer 0 is off by 0.1, expected at most 0.05" in complaint


def test_a_file_may_say_more_than_the_service_asks_for(tmp_path: Path) -> None:
    model = read(write(tmp_path / "net.onnx", *networks.default(seed=3, data_sha256="ab")))
    assert model.contract.calibration.offset == -0.25
    assert model.contract.fusion == "looks"


@pytest.mark.parametrize("made", [networks.paper, networks.default])
def test_what_is_no_model_of_ours_is_refused(tmp_path: Path, made: Made) -> None:
    graph, contract = made()
    assert "has no metadata 'echogrid': it was not exported for this service" in refused(write(tmp_path / "net.onnx", graph, None))
    for text in ("{", "[]", '{"version": 2}'):
        assert "metadata 'echogrid': " in refused(write(tmp_path / "net.onnx", graph, text))
    for shape in ((1, 2, 16, 16), (1, 48, 16, 16), ("N", 1, 16, 16)):
        taken = helper.make_tensor_value_info("image", TensorProto.FLOAT, shape)
        flat = helper.make_graph([helper.make_node("Cast", ["image"], ["answer"], to=1)], "flat", [taken], [floats("answer", shape)])
        assert "takes a tensor(float) of shape" in refused(write(tmp_path / "net.onnx", flat, contract))


def floats(name: str, shape: tuple[int | str, ...]) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def test_a_network_with_a_second_input_or_output_is_refused(tmp_path: Path) -> None:
    graph, contract = networks.paper()
    graph.input.append(floats("more", (1, 16, 16)))
    graph.node.append(helper.make_node("Identity", ["more"], ["too"]))
    graph.output.append(floats("too", (1, 16, 16)))
    assert "has inputs image, more and outputs answer, too, expected one of each" in refused(write(tmp_path / "net.onnx", graph, contract))


def test_a_network_that_breaks_when_it_runs_is_refused(tmp_path: Path) -> None:
    """Half as many numbers as fit the shape that it promises: nothing to be seen before it runs."""
    _, contract = networks.paper()
    nodes = [
        helper.make_node("NonZero", ["image"], ["where"]),
        helper.make_node("Cast", ["where"], ["numbers"], to=TensorProto.FLOAT),
        helper.make_node("Reshape", ["numbers", "shape"], ["answer"]),
    ]
    shape = helper.make_tensor("shape", TensorProto.INT64, [3], [1, 16, 16])
    graph = helper.make_graph(nodes, "breaks", [floats("image", (1, 1, 16, 16))], [floats("answer", (1, 16, 16))], [shape])
    assert "does not run: " in refused(write(tmp_path / "net.onnx", graph, contract))


def test_what_cannot_be_read_is_said(tmp_path: Path) -> None:
    (tmp_path / "noise.onnx").write_bytes(b"noise")
    assert "is not an ONNX model that onnxruntime reads" in refused(tmp_path / "noise.onnx")
    (tmp_path / "empty.onnx").touch()
    assert "is not an ONNX model that onnxruntime reads" in refused(tmp_path / "empty.onnx")
    assert "cannot be read: No such file" in refused(tmp_path / "none.onnx")
    assert "is a folder, expected a file" in refused(tmp_path)


def test_the_networks_here_tell_the_classes_apart() -> None:
    """Else the tests above would test nothing."""
    assert set(logits(image(3)).argmax(axis=0).reshape(-1).tolist()) == {0, 1, 2}
    assert logits(np.zeros((PLANES, 1, 1)))[:, 0, 0].argmax() == 1  # where nothing was seen
    assert CLASSES.any(axis=1).tolist() == [True, False, True]


def test_onnxruntime_keeps_no_record_of_its_use(tmp_path: Path) -> None:
    """It would leave a device's id in the home folder and send it to its makers."""
    code = "from echogrid.model.choice import choose; import onnxruntime; onnxruntime.SessionOptions()"
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("XDG_", "ORT_"))} | {"HOME": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True, timeout=PATIENCE)
    assert list(tmp_path.rglob("*")) == []
