"""A trained network as ONNX files that carry their own contract, compared with PyTorch on other images than they were traced with."""

from __future__ import annotations

import logging
import math
import warnings
import zlib
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import pixel_unshuffle
from torch.nn.utils.fusion import fuse_conv_bn_weights

from echogrid.core.evidence.history_raster import CHANNELS, Bytes
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration
from echogrid.errors import EchogridError
from echogrid.model.network import KEY, PAPER, VERSION, Contract, Golden, OnnxSensorModel, Precision, coarse, fed, unfolded
from echogrid_training.learning.autoencoder import CELLS, SLOPE, PaperAutoencoder
from echogrid_training.learning.dataset import Samples
from echogrid_training.learning.quantise import quantised, streamlined
from echogrid_training.learning.train import Trained
from echogrid_training.learning.unet import CLASS_WEIGHTS, UNet, corrected

OPSET = 18
INPUT, OUTPUT = "image", "answer"
REGISTRY = "torch.onnx._internal.exporter._registration"  # warns of every operator of torchvision that is not there
SHARES = (0.0, 0.001, 0.02, 0.3)  # of cells that are not 0, in images to compare by
PARITY = 1e-4  # logits between PyTorch and ONNX Runtime; what is seen is 1e-5


class TrainedContract(Contract, frozen=True, kw_only=True):
    """What the service demands, and where the network comes from."""

    network: str
    weighting: str | None  # of classes in the paper's loss
    class_shares: tuple[float, float, float]  # of free, unknown and occupied cells in what was learned from
    epochs: int
    seed: int
    data_sha256: str  # of the samples that were learned from
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


class ExportedPaper(nn.Module):
    """What its file holds: (1, 1, 128, 128) of -1 and 1 -> log-odds (1, 128, 128)."""

    def __init__(self, model: PaperAutoencoder) -> None:
        super().__init__()
        self.layers = rewritten(model)

    def forward(self, image: Tensor) -> Tensor:
        log_odds: Tensor = self.layers(image)[:, 0]
        return log_odds


class ExportedUNet(nn.Module):
    """What its files hold: folded bytes (1, 48, 64, 64), or those / 255 -> folded class logits (1, 12, 64, 64).

    The logits are of the classes' own shares: the head's bias takes the loss's weights out.
    """

    def __init__(self, model: UNet) -> None:
        super().__init__()
        self.core = model.core
        with torch.no_grad():
            assert self.core.head.bias is not None
            self.core.head.bias -= torch.tensor([math.log(weight) for weight in CLASS_WEIGHTS]).repeat_interleave(4)

    def forward(self, image: Tensor) -> Tensor:
        logits: Tensor = self.core(image.float() / 255 if image.dtype == torch.uint8 else image)
        return logits


def export(trained: Trained, out: Path, calibration: Calibration, calibrating: Bytes | None = None) -> list[Path]:
    """Writes NETWORK.onnx and, with images (N, 12, 128, 128) to choose the steps by, NETWORK.int8.onnx.

    A file appears once the service would take it and, in float, it agrees with PyTorch. Raises EchogridError where it does not, and
    leaves what was there.
    """
    out.mkdir(parents=True, exist_ok=True)
    name = trained.settings.network
    kind = torch.float32 if name == "paper" else torch.uint8
    written = [write(trained, out / f"{name}.onnx", traced(trained, kind), "float", calibration)]
    if calibrating is not None:
        shown = pixel_unshuffle(torch.from_numpy(calibrating).float() / 255, 2).numpy()
        graph = traced(trained, torch.float32)
        written.append(write(trained, out / f"{name}.int8.onnx", streamlined(quantised(graph, INPUT, shown)), "int8", calibration))
    return written


def traced(trained: Trained, kind: torch.dtype) -> onnx.ModelProto:
    """The network as a graph of static shape, traced with an empty image of this kind of number."""
    model, side = trained.model(), CELLS
    if isinstance(model, PaperAutoencoder):
        exported: nn.Module = ExportedPaper(model)
        empty = torch.full((1, 1, side, side), -1.0)
    else:
        assert isinstance(model, UNet)
        exported = ExportedUNet(model)
        empty = torch.zeros((1, 4 * len(CHANNELS), side // 2, side // 2), dtype=kind)
    logging.getLogger(REGISTRY).setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`isinstance\(treespec, LeafSpec\)` is deprecated", FutureWarning)  # of PyTorch's own insides
        program = torch.onnx.export(
            exported.eval(), (empty,), input_names=[INPUT], output_names=[OUTPUT], opset_version=OPSET, dynamo=True, verbose=False
        )
    assert program is not None
    return bare(program.model_proto)


def bare(proto: onnx.ModelProto) -> onnx.ModelProto:
    """The same graph without what PyTorch notes of every node: lines of source, and the paths of the machine that exported it."""
    graph = proto.graph
    for part in (graph, *graph.node, *graph.input, *graph.output, *graph.value_info, *graph.initializer):
        part.ClearField("metadata_props")
        part.ClearField("doc_string")
    return proto


def write(trained: Trained, path: Path, proto: onnx.ModelProto, precision: Precision, calibration: Calibration) -> Path:
    """With its contract, whose golden answers are the file's own."""
    session = onnxruntime.InferenceSession(proto.SerializeToString(), providers=["CPUExecutionProvider"])
    images = [drawn(trained, image) for image in trained.golden.numpy()]
    goldens = []
    for image in images:
        (answer,) = session.run(None, {INPUT: fed(image)})
        planes = answer if len(image) == 1 else unfolded(answer[0])
        goldens.append(Golden(zlib.compress(image.tobytes(), 9), coarse(planes).astype("<f4").tobytes()))
    onnx.helper.set_model_props(proto, {KEY: msgspec.json.encode(contract(trained, precision, calibration, goldens)).decode()})
    onnx.checker.check_model(proto, full_check=True)
    partial = path.with_name(f".{path.stem}.partial.onnx")
    onnx.save(proto, partial)
    try:
        model = OnnxSensorModel(partial, GridSpec(), {})  # as the service takes it
        if precision == "float":
            compare(trained, model)
    except EchogridError:
        partial.unlink()
        raise
    return partial.replace(path)


def contract(trained: Trained, precision: Precision, calibration: Calibration, golden: list[Golden]) -> TrainedContract:
    settings = trained.settings
    paper = settings.network == "paper"
    return TrainedContract(
        version=VERSION,
        cells=CELLS,
        cell=GridSpec().cell,
        channels=PAPER if paper else CHANNELS,
        output="log-odds" if paper else "class-logits",
        precision=precision,
        fusion="sum" if paper else "looks",
        calibration=calibration,
        golden=tuple(golden),
        network=settings.network,
        weighting=settings.weighting if paper else None,
        class_shares=trained.shares,
        epochs=settings.epochs,
        seed=settings.seed,
        data_sha256=trained.data_sha256,
        echogrid_training=version("echogrid-training"),
    )


def drawn(trained: Trained, image: Bytes) -> Bytes:
    """(C, H, W) that the network is shown, of all twelve planes (12, H, W)."""
    return (image[:1] > 0).astype(np.uint8) if trained.settings.network == "paper" else image


def compare(trained: Trained, model: OnnxSensorModel) -> float:
    """The largest difference of logits between PyTorch and ONNX Runtime over images that nothing was traced with.

    Raises EchogridError beyond PARITY.
    """
    rng = np.random.default_rng(1)
    sparse = [(rng.uniform(size=trained.golden.shape[1:]) < share) * rng.integers(1, 256, trained.golden.shape[1:]) for share in SHARES]
    worst = 0.0
    for image in [*trained.golden.numpy(), *(one.astype(np.uint8) for one in sparse)]:
        worst = max(worst, float(np.abs(model.run(drawn(trained, image)) - answered(trained, image)).max()))
    if not worst <= PARITY:  # NaN too
        raise EchogridError(f"{model.path}: differs from PyTorch by up to {worst:.2g} of logits, expected at most {PARITY:g}")
    return worst


@torch.inference_mode()
def answered(trained: Trained, image: Bytes) -> NDArray[np.float32]:
    """(P, H, W): what PyTorch makes of all twelve planes (12, H, W), as the exported file would say it."""
    alone = Samples.empty(1)
    alone.images[0] = image
    shown, _ = trained.recipe().shown(alone)
    output = trained.model()(shown)
    planes: NDArray[np.float32] = (output if trained.settings.network == "paper" else corrected(output)[0]).numpy()
    return planes
