"""Weights to begin with, out of a network's float file: its batch norms are folded there, and are unfolded here."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from echogrid.core.evidence.raster import GridSpec
from echogrid.errors import EchogridError
from echogrid.model.network import OnnxSensorModel
from echogrid_training.learning.dataset import Samples
from echogrid_training.learning.recipe import Default
from echogrid_training.learning.unet import CLASS_WEIGHTS, UNet

SHOWN = 256  # images that the norms' statistics are taken from
RATE = 1e-3  # at the peak of the cycle: half of what random weights need


def started(path: Path, samples: Samples) -> dict[str, Tensor]:
    """The state of a UNet that answers as the float file `path` does, its norms' statistics those of some of the samples.

    A norm's scale and shift undo its statistics, so that they change nothing until training moves them. Raises EchogridError.
    """
    return _state(_folded(path), path, samples)


def between(first: Path, second: Path, keep: float, samples: Samples) -> dict[str, Tensor]:
    """As `started`, of weights that are `keep` times those of `first` and 1 - `keep` times those of `second`, which went on from it.

    What was learned last is kept without losing what came before: Wortsman et al., "Robust fine-tuning of zero-shot models", CVPR 2022,
    arXiv:2109.01903. Raises EchogridError.
    """
    held, other = _folded(first), _folded(second)
    if {name: one.shape for name, one in held.items()} != {name: one.shape for name, one in other.items()}:
        raise EchogridError(f"{first}: weights of other names or shapes than in {second}; give float files of the default network")
    return _state({name: keep * one + (1 - keep) * other[name] for name, one in held.items()}, first, samples)


def _folded(path: Path) -> dict[str, Tensor]:
    """The float weights of a file, by name."""
    OnnxSensorModel(path, GridSpec(), {})  # what the service would not take is said as the service says it
    held = {one.name: torch.from_numpy(numpy_helper.to_array(one).copy()) for one in onnx.load(path).graph.initializer}
    return {name: one for name, one in held.items() if one.is_floating_point()}


def _state(held: dict[str, Tensor], path: Path, samples: Samples) -> dict[str, Tensor]:
    """`path`: for what is wrong with the weights."""
    model = UNet()
    norms = []
    for name, block in model.named_modules():
        if not isinstance(block, nn.Sequential) or not isinstance(block[1], nn.BatchNorm2d):
            continue
        convolution, norm = block[0], block[1]
        assert isinstance(convolution, nn.Conv2d)
        norms.append(norm)
        put(convolution.weight, held, f"{name}.0.weight", path)
        put(norm.bias, held, f"{name}.0.weight_bias", path)
        nn.init.constant_(norm.weight, math.sqrt(1.0 + norm.eps))  # less what a variance of 1 divides by
    head = model.core.head
    assert head.bias is not None
    put(head.weight, held, "core.head.weight", path)
    put(head.bias, held, "core.head.bias", path)
    with torch.no_grad():
        head.bias += torch.tensor([math.log(weight) for weight in CLASS_WEIGHTS]).repeat_interleave(4)  # which export took out
    _unfold(model.eval(), norms, samples)
    return model.state_dict()


@torch.no_grad()
def put(weight: Tensor, held: dict[str, Tensor], name: str, path: Path) -> None:
    """Writes the file's numbers of that name into a weight of the same shape."""
    if name not in held or held[name].shape != weight.shape:
        found = "none" if name not in held else str(tuple(held[name].shape))
        raise EchogridError(
            f"{path}: weights {name}: found {found}, expected {tuple(weight.shape)}; give a float file of the default network"
        )
    weight.copy_(held[name])


@torch.no_grad()
def _unfold(model: UNet, norms: list[nn.BatchNorm2d], samples: Samples) -> None:
    """Gives every norm the mean and variance of what it is shown, and the scale and shift that undo them."""
    seen: dict[nn.Module, tuple[Tensor, Tensor]] = {}

    def look(norm: nn.Module, given: tuple[Tensor]) -> None:
        seen[norm] = given[0].mean(dim=(0, 2, 3)), given[0].var(dim=(0, 2, 3), unbiased=False)

    hooks = [norm.register_forward_pre_hook(look) for norm in norms]
    some = samples.chosen(np.unique(np.linspace(0, len(samples) - 1, min(len(samples), SHOWN)).astype(np.intp)))
    model(Default((1.0, 1.0, 1.0)).shown(some)[0])
    for hook in hooks:
        hook.remove()
    for norm in norms:
        mean, variance = seen[norm]
        assert norm.running_mean is not None
        assert norm.running_var is not None
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.copy_(torch.sqrt(variance + norm.eps))
        norm.bias.add_(mean)
