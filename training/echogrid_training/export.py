"""A trained network as an ONNX file that carries its own contract, compared with PyTorch on other images than it was traced with."""

from __future__ import annotations

import logging
import warnings
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
import onnx
import onnxruntime
import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_weights

from echogrid.core.raster import GridSpec
from echogrid.errors import EchogridError
from echogrid.io.model import CHANNELS as DRAWN
from echogrid.io.model import KEY, RANGE, VERSION, Contract, Golden, OnnxSensorModel, coarse
from echogrid.io.model import OUTPUT as MEANING
from echogrid_training.model import CELLS, CHANNELS, SLOPE, PaperAutoencoder, probe
from echogrid_training.train import Trained

OPSET = 18
INPUT, OUTPUT = "image", "log_odds"  # (1, 1, 128, 128) in [-1, 1] and (1, 128, 128)
REGISTRY = "torch.onnx._internal.exporter._registration"  # warns of every operator of torchvision that is not there
PARITY = 1e-4  # log-odds between PyTorch and ONNX Runtime; what is seen is 1e-5


class TrainedContract(Contract, frozen=True, kw_only=True):
    """What the service demands, and where the network comes from."""

    weighting: str
    labels: str
    width: int
    epochs: int
    seed: int
    data_sha256: str  # of the samples of all drives that were learned from
    calibration: tuple[float, float]  # a, b: a * output + b are log-odds where something was observed
    echogrid_training: str  # version


class Deconvolution(nn.Module):
    """A deconvolution k4 s2 p1 as a convolution k2, depth to space, and a border of one cell cut off: exactly the same sums.

    Output row 2 q + r - 1 reads input row q through the kernel's row r, and row q - 1 through r + 2. ONNX Runtime has no int8 kernel for
    ConvTranspose but a good one for Conv.
    """

    def __init__(self, weight: Tensor, bias: Tensor) -> None:
        """weight (I, O, 4, 4) and bias (O,) of the deconvolution."""
        super().__init__()
        channels, out = weight.shape[:2]
        self.conv = nn.Conv2d(channels, 4 * out, 2, padding=1)
        split = weight.reshape(channels, out, 2, 2, 2, 2).flip(2, 4)  # (I, O, q, row r, q, column r): q - 1 first
        self.conv.weight = nn.Parameter(split.permute(1, 3, 5, 0, 2, 4).reshape(4 * out, channels, 2, 2).contiguous())
        self.conv.bias = nn.Parameter(bias.repeat_interleave(4))
        self.spread = nn.PixelShuffle(2)

    def forward(self, x: Tensor) -> Tensor:
        spread: Tensor = self.spread(self.conv(x))[..., 1:-1, 1:-1]
        return spread


def rewritten(model: PaperAutoencoder) -> nn.Sequential:
    """The same function (B, 1, 128, 128) -> (B, 1, 128, 128) without batch norms and deconvolutions."""
    layers: list[nn.Module] = []
    for block in model.encoder:
        weight, bias = folded(block)
        conv = nn.Conv2d(weight.shape[1], weight.shape[0], 4, stride=2, padding=1)
        conv.weight, conv.bias = weight, bias
        layers += [conv, nn.LeakyReLU(SLOPE)]
    for block in model.decoder:
        layers += [Deconvolution(*folded(block)), nn.LeakyReLU(SLOPE)]
    return nn.Sequential(*layers, model.head).eval().requires_grad_(False)


def folded(block: nn.Module) -> tuple[nn.Parameter, nn.Parameter]:
    """Weight and bias of a block's convolution together with its batch norm, as it is after training."""
    conv, norm, _ = block.children()
    assert isinstance(conv, nn.Conv2d | nn.ConvTranspose2d)
    assert isinstance(norm, nn.BatchNorm2d)
    transpose = isinstance(conv, nn.ConvTranspose2d)
    mean, variance = norm.running_mean, norm.running_var
    assert mean is not None
    assert variance is not None
    return fuse_conv_bn_weights(conv.weight, conv.bias, mean, variance, norm.eps, norm.weight, norm.bias, transpose)


class Exported(nn.Module):
    """What the file holds: (1, 1, 128, 128) -> (1, 128, 128)."""

    def __init__(self, model: PaperAutoencoder) -> None:
        super().__init__()
        self.layers = rewritten(model)

    def forward(self, image: Tensor) -> Tensor:
        log_odds: Tensor = self.layers(image)[:, 0]
        return log_odds


def export(trained: Trained, path: Path) -> Path:
    """Writes the file once it agrees with PyTorch. Raises EchogridError where it does not, and leaves what was there."""
    model = trained.model()
    partial = path.with_name(f".{path.name}.partial")
    proto = traced(model)
    onnx.helper.set_model_props(proto, {KEY: msgspec.json.encode(contract(trained, model)).decode()})
    onnx.checker.check_model(proto, full_check=True)
    onnx.save(proto, partial)
    try:
        compare(model, partial, trained.golden)
    except EchogridError:
        partial.unlink()
        raise
    return partial.replace(path)


def traced(model: PaperAutoencoder) -> onnx.ModelProto:
    """The network as a graph of static shape, traced with an empty image."""
    empty = probe(0, 0)
    logging.getLogger(REGISTRY).setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`isinstance\(treespec, LeafSpec\)` is deprecated", FutureWarning)  # of PyTorch's own insides
        program = torch.onnx.export(
            Exported(model).eval(), (empty,), input_names=[INPUT], output_names=[OUTPUT], opset_version=OPSET, dynamo=True, verbose=False
        )
    assert program is not None
    proto: onnx.ModelProto = program.model_proto
    return proto


def contract(trained: Trained, model: PaperAutoencoder) -> TrainedContract:
    settings = trained.settings
    return TrainedContract(
        version=VERSION,
        cells=CELLS,
        cell=GridSpec().cell,
        channels=DRAWN,
        input_range=RANGE,
        output=MEANING,
        weighting=settings.weighting,
        labels=settings.labels,
        width=settings.width,
        epochs=settings.epochs,
        seed=settings.seed,
        data_sha256=trained.data_sha256,
        calibration=trained.calibration,
        golden=tuple(golden(model, occupied) for occupied in trained.golden),
        echogrid_training=version("echogrid-training"),
    )


def golden(model: PaperAutoencoder, occupied: list[int]) -> Golden:
    with torch.inference_mode():
        means = coarse(model(drawn(occupied))[0].numpy())
    return Golden(np.array(occupied, "<u2").tobytes(), means.astype("<f4").tobytes())


def drawn(occupied: list[int]) -> Tensor:
    """(1, 1, 128, 128) image of flat indices."""
    image = torch.full((CHANNELS * CELLS * CELLS,), -1.0)
    image[occupied] = 1.0
    return image.view(1, CHANNELS, CELLS, CELLS)


def compare(model: PaperAutoencoder, path: Path, golden: list[list[int]]) -> float:
    """The largest difference of log-odds between PyTorch and ONNX Runtime over images that nothing was traced with.

    Raises EchogridError beyond PARITY, or where the service would not take the file.
    """
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    images = [*(probe(seed, count) for seed, count in ((1, 1), (2, 40), (3, 250), (4, 1000))), *(drawn(one) for one in golden)]
    worst = 0.0
    for image in images:
        with torch.inference_mode():
            expected = model(image).numpy()
        (found,) = session.run([OUTPUT], {INPUT: image.numpy()})
        worst = max(worst, float(np.abs(found - expected).max()))
    if not worst <= PARITY:  # NaN too
        raise EchogridError(f"{path}: differs from PyTorch by up to {worst:.2g} of log-odds, expected at most {PARITY:g}")
    OnnxSensorModel(path, GridSpec())  # as the service takes it: contract and golden answers
    return worst
