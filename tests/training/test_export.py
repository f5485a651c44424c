"""The ONNX file: the rewritten network, its contract, and its comparison with PyTorch."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from torch import nn

from echogrid.core.raster import GridSpec, rasterize
from echogrid.errors import EchogridError
from echogrid.io.model import OnnxSensorModel
from echogrid_training import export
from echogrid_training.export import Deconvolution, compare, rewritten
from echogrid_training.model import PaperAutoencoder, probe
from echogrid_training.train import Settings, Trained


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
    points = np.random.default_rng(1).uniform(-15, 15, size=(3, 60, 2))
    golden = [np.flatnonzero(rasterize(one, GridSpec()) > 0).tolist() for one in points]
    return Trained(Settings(width=4, seed=7), lived().state_dict(), "ab" * 32, (0.9, -2.5), golden)


@pytest.fixture(scope="module")
def file(trained: Trained, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export.export(trained, tmp_path_factory.mktemp("export") / "model.onnx")


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


def test_the_file_is_plain_static_and_small(file: Path) -> None:
    proto = onnx.load(file)
    assert {node.op_type for node in proto.graph.node} <= {"Conv", "LeakyRelu", "DepthToSpace", "Slice", "Squeeze", "Gather", "Reshape"}
    assert [entry.version for entry in proto.opset_import if entry.domain == ""] == [18]
    assert [path.name for path in file.parent.iterdir()] == ["model.onnx"]
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    assert [(one.name, one.shape) for one in session.get_inputs()] == [("image", [1, 1, 128, 128])]
    assert [(one.name, one.shape) for one in session.get_outputs()] == [("log_odds", [1, 128, 128])]


def test_onnx_runtime_gives_what_pytorch_gives(file: Path, trained: Trained) -> None:
    assert compare(trained.model(), file, trained.golden) < 5e-5


def test_another_network_is_noticed(file: Path, trained: Trained) -> None:
    with pytest.raises(EchogridError, match=r"model.onnx: differs from PyTorch by up to .* of log-odds, expected at most 0.0001"):
        compare(lived(seed=2), file, trained.golden)


def test_a_file_that_differs_is_not_written(file: Path, trained: Trained, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    proto = onnx.load(file)
    monkeypatch.setattr(export, "traced", lambda _: proto)
    with pytest.raises(EchogridError, match="differs from PyTorch"):
        export.export(replace(trained, weights=lived(seed=2).state_dict()), tmp_path / "model.onnx")
    assert list(tmp_path.iterdir()) == []


def test_the_service_takes_the_file_and_says_what_pytorch_says(file: Path, trained: Trained) -> None:
    infer = OnnxSensorModel(file, GridSpec())
    points = np.random.default_rng(3).uniform(-15, 15, (120, 2))
    image = rasterize(points, GridSpec())
    with torch.inference_mode():
        expected = trained.model()(torch.from_numpy(image)[None])[0].numpy()
    np.testing.assert_allclose(infer(image), expected, atol=1e-4)


def test_the_contract_says_where_the_network_comes_from(file: Path, trained: Trained) -> None:
    props = {entry.key: entry.value for entry in onnx.load(file).metadata_props}
    contract = json.loads(props["echogrid"])
    assert (contract["weighting"], contract["seed"], contract["data_sha256"]) == ("independent", 7, "ab" * 32)
    assert contract["calibration"] == [0.9, -2.5]
    for golden, cells in zip(contract["golden"], trained.golden, strict=True):
        assert np.frombuffer(base64.b64decode(golden["occupied"]), "<u2").tolist() == cells
