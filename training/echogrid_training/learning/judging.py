"""What a network answers about samples, and how far that is from their labels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor, nn

from echogrid_training.learning.dataset import Samples, soft, ternary
from echogrid_training.learning.loss import class_mse, class_sums
from echogrid_training.learning.recipe import Recipe


def judge(recipe: Recipe, model: nn.Module, samples: Samples) -> dict[str, dict[str, float]]:
    """Class MSE, pooled over all pixels: 'ternary' against labels -1, 0 and 1 as in the paper's Table I, 'soft' against tanh(L / 2)."""
    return {name: class_mse(total) for name, total in errors(recipe, model, samples).items()}


def errors(recipe: Recipe, model: nn.Module, samples: Samples) -> dict[str, Tensor]:
    """What `judge` is made of: loss.class_sums of all samples, which add up over towns."""
    sums = {"ternary": torch.zeros(2, 3, dtype=torch.float64), "soft": torch.zeros(2, 3, dtype=torch.float64)}
    for output, labels in inferred(recipe, model, samples):
        answer = recipe.label(output)
        for name, label in (("ternary", ternary(labels)), ("soft", soft(labels))):
            sums[name] += class_sums(answer, torch.from_numpy(label))
    return sums


def held_out_loss(way: Recipe, model: nn.Module, samples: Samples) -> float:
    """Sum over samples."""
    total = 0.0
    for first, (output, labels) in enumerate(inferred(way, model, samples, 1)):
        total += float(way.loss(output, way.shown(samples.chosen(np.arange(first, first + len(labels))))[1]))
    return total


@torch.inference_mode()
def inferred(recipe: Recipe, model: nn.Module, samples: Samples, size: int = 64) -> Iterator[tuple[Tensor, np.ndarray]]:
    """Outputs and stored labels (n, 128, 128) of all samples, in order."""
    model.eval()
    device = next(model.parameters()).device
    for start in range(0, len(samples), size):
        some = samples.chosen(np.arange(start, min(start + size, len(samples))))
        image, _ = recipe.shown(some)
        yield model(image.to(device)).float().cpu(), some.labels
