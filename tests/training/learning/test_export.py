"""The ONNX files: the rewritten networks, their contract, and their comparison with PyTorch."""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from tests.support.rectangles import rectangles
from torch import nn

import echogrid
from echogrid.core.evidence.history_raster import CHANNELS
from echogrid.core.evidence.raster import GridSpec, rasterize
from echogrid.core.map.look_map import Calibration
from echogrid.errors import EchogridError
from echogrid.model.network import OnnxSensorModel
from echogrid_training.learning import export
from echogrid_training.learning.autoencoder import PaperAutoencoder, probe
from echogrid_training.learning.export import PARITY, Deconvolution, compare, rewritten
from echogrid_training.learning.train import Settings, Trained
from echogrid_training.learning.unet import corrected


def lived(width: int = 4, seed: int = 1) -> PaperAutoencoder:
    """A network whose batch norms are not at their start, with logits of the size that a trained one has."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = PaperAutoencoder(width)
        for norm in model.modules():
            if isinstance(norm, nn.BatchNorm2d):
                nn.init.uniform_(norm.weight, 0.5, 1.5)
                nn.init.normal_(norm.bias, 0.0, 0.3)
                norm.momentum = None  # statistics of exactly what it sees now
        model.head.weight.data /= model(probe(seed, 200, batch=8)).std() / 2
    return model.eval()


@pytest.fixture(scope="module")
def trained() -> Trained:
    images = rectangles(3, 1).images
    settings = Settings("paper", width=4, seed=7)
    return Trained(settings, lived().state_dict(), "ab" * 32, (0.9, -2.5), torch.from_numpy(images), (0.6, 0.37, 0.03))


@pytest.fixture(scope="module")
def file(trained: Trained, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (path,) = export.export(trained, tmp_path_factory.mktemp("export"), Calibration())
    return path


def read(path: Path) -> OnnxSensorModel:
    return OnnxSensorModel(path, GridSpec(), {})


@pytest.mark.parametrize(("height", "width"), [(4, 4), (5, 8), (1, 3)])
def test_a_deconvolution_is_a_convolution_with_depth_to_space(height: int, width: int) -> None:
    torch.manual_seed(height)
    layer = nn.ConvTranspose2d(6, 5, 4, stride=2, padding=1)
    assert layer.bias is not None
    x = torch.randn(2, 6, height, width)
    with torch.inference_mode():
        torch.testing.assert_close(Deconvolution(layer.weight, layer.bias)(x), layer(x), rtol=0, atol=1e-5)


def test_the_rewritten_network_is_the_same_function() -> None:
    model = lived(16).double()
    layers = rewritten(model)
    assert not any(isinstance(layer, nn.ConvTranspose2d | nn.BatchNorm2d) for layer in layers.modules())
    with torch.inference_mode():
        for image in (probe(1, 0).double(), probe(2, 50, batch=2).double(), probe(3, 16384).double()):
            torch.testing.assert_close(layers(image)[:, 0], model(image), rtol=0, atol=1e-12)
    model, layers = model.float(), layers.float()
    with torch.inference_mode():
        torch.testing.assert_close(layers(probe(2, 200))[:, 0], model(probe(2, 200)), rtol=0, atol=5e-5)  # sums in another order


def test_the_papers_file_is_plain_static_and_small(file: Path) -> None:
    proto = onnx.load(file)
    assert {node.op_type for node in proto.graph.node} <= {"Conv", "LeakyRelu", "DepthToSpace", "Slice", "Squeeze", "Gather", "Reshape"}
    assert [entry.version for entry in proto.opset_import if entry.domain == ""] == [18]
    assert [path.name for path in file.parent.iterdir()] == ["paper.onnx"]
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    assert [(one.name, one.type, one.shape) for one in session.get_inputs()] == [("image", "tensor(float)", [1, 1, 128, 128])]
    assert [(one.name, one.shape) for one in session.get_outputs()] == [("answer", [1, 128, 128])]


def test_no_file_tells_of_the_machine_that_made_it(file: Path, unet_files: dict[str, Path]) -> None:
    """PyTorch writes the stack of every operator into the graph."""
    shipped = (Path(echogrid.__file__).parent / "models").glob("*.onnx")
    for path in (file, *unet_files.values(), *shipped):
        assert not any(mark in path.read_bytes() for mark in (b"site-packages", b"export.py", b"unet.py")), path


def test_the_defaults_file_takes_folded_bytes(unet_files: dict[str, Path]) -> None:
    """Nothing but convolutions, and nearest neighbours on the way up: no folding, no batch norm, no deconvolution."""
    assert list(unet_files) == ["default.onnx", "default.int8.onnx"]
    proto = onnx.load(unet_files["default.onnx"])
    assert {node.op_type for node in proto.graph.node} <= {"Cast", "Div", "Conv", "Relu", "Concat", "Resize"}
    for path in unet_files.values():
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        assert [(one.name, one.type, one.shape) for one in session.get_inputs()] == [("image", "tensor(uint8)", [1, 48, 64, 64])]
        assert [(one.name, one.shape) for one in session.get_outputs()] == [("answer", [1, 12, 64, 64])]


def test_onnx_runtime_gives_what_pytorch_gives(
    file: Path, trained: Trained, unet_files: dict[str, Path], unet: tuple[Trained, Path]
) -> None:
    assert compare(trained, read(file)) < PARITY
    assert compare(unet[0], read(unet_files["default.onnx"])) < PARITY


def test_another_network_is_noticed(file: Path, trained: Trained) -> None:
    other = replace(trained, weights=lived(seed=2).state_dict())
    with pytest.raises(EchogridError, match=r"paper.onnx: differs from PyTorch by up to .* of logits, expected at most 0.0001"):
        compare(other, read(file))


def test_a_file_that_differs_is_not_written(file: Path, trained: Trained, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """And what was there before stays."""
    proto = onnx.load(file)
    monkeypatch.setattr(export, "traced", lambda *_: proto)
    (tmp_path / "paper.onnx").write_text("before")
    with pytest.raises(EchogridError, match="differs from PyTorch"):
        export.export(replace(trained, weights=lived(seed=2).state_dict()), tmp_path, Calibration())
    assert [path.name for path in tmp_path.iterdir()] == ["paper.onnx"]
    assert (tmp_path / "paper.onnx").read_text() == "before"


def test_the_service_takes_the_papers_file_and_says_what_pytorch_says(file: Path, trained: Trained) -> None:
    image = rasterize(np.random.default_rng(3).uniform(-15, 15, (120, 2)), GridSpec())
    with torch.inference_mode():
        expected = trained.model()(torch.from_numpy(image)[None])[0].numpy()
    log_odds, weight = read(file).answer((image > 0).astype(np.uint8))
    np.testing.assert_allclose(log_odds, expected, atol=1e-4)
    assert (weight == 1).all()


def test_the_service_takes_the_defaults_file_and_says_what_pytorch_says(unet_files: dict[str, Path], unet: tuple[Trained, Path]) -> None:
    """Classes by their own shares: PyTorch's logits less the loss's weights, as probabilities."""
    trained, _ = unet
    image = rectangles(1, 9).images
    with torch.inference_mode():
        logits = trained.model()(torch.from_numpy(image).float() / 255)
    free, _, occupied = corrected(logits).softmax(dim=1)[0].double().numpy()
    log_odds, weight = read(unet_files["default.onnx"]).answer(image[0])
    np.testing.assert_allclose(weight, free + occupied, atol=1e-4)
    np.testing.assert_allclose(log_odds, trained.recipe().log_odds(logits)[0].numpy(), atol=1e-3)
    likely = (free > 1e-3) & (occupied > 1e-3)
    np.testing.assert_allclose(log_odds[likely], np.log(occupied / free)[likely], atol=1e-3)


def test_the_contract_says_what_to_draw_and_where_the_network_comes_from(
    file: Path, trained: Trained, unet_files: dict[str, Path], unet: tuple[Trained, Path]
) -> None:
    contract = contract_of(file)
    assert (contract["network"], contract["weighting"], contract["seed"], contract["data_sha256"]) == ("paper", "independent", 7, "ab" * 32)
    assert (contract["channels"], contract["output"], contract["fusion"]) == (["detections"], "log-odds", "sum")
    assert contract["class_shares"] == [0.6, 0.37, 0.03]
    for golden, image in zip(contract["golden"], trained.golden.numpy(), strict=True):
        assert packed_in(golden) == (image[:1] > 0).astype(np.uint8).tobytes()
    for name, path in unet_files.items():
        contract = contract_of(path)
        assert (contract["network"], contract["weighting"], contract["data_sha256"]) == ("default", None, unet[0].data_sha256)
        assert (contract["channels"], contract["output"], contract["fusion"]) == (list(CHANNELS), "class-logits", "looks")
        assert contract["precision"] == ("float" if name == "default.onnx" else "int8")
        assert contract["calibration"] == {"learned": 1.5, "offset": -1.0}
        assert [packed_in(golden) for golden in contract["golden"]] == [image.tobytes() for image in unet[0].golden.numpy()]


def contract_of(path: Path) -> dict[str, Any]:
    props = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
    contract: dict[str, Any] = json.loads(props["echogrid"])
    return contract


def packed_in(golden: dict[str, str]) -> bytes:
    return zlib.decompress(base64.b64decode(golden["image"]))
