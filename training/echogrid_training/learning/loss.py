"""The paper's weighted reconstruction loss, and the errors by class of its Table I.

A label is in [-1, 1]: below 0 free, 0 unknown, above 0 occupied; its class is its sign. B is the number of all pixels of a batch, B_c of
those of a class: counted over the batch, since single patches may have few occupied pixels or none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from echogrid_training.learning.logistic import fit_logistic

Weighting = Literal["inverse", "independent"]
CLASSES = {"free": -1, "unknown": 0, "occupied": 1}


def reconstruction_loss(logits: Tensor, label: Tensor, weighting: Weighting) -> Tensor:
    """Scalar: the sum of alpha (tanh(logits / 2) - label)² over (B, H, W) logits and (B, H, W) labels in [-1, 1].

    The paper's L2 on the weights is train.py's.
    """
    return (pixel_weights(label, weighting) * (torch.tanh(logits / 2) - label).square()).sum()


def pixel_weights(label: Tensor, weighting: Weighting) -> Tensor:
    """alpha (B, H, W) of labels (B, H, W). A class without pixels has no weight.

    inverse: (1 - B_c / B) / B, the paper's inverse class ratio as a mean over pixels. independent: 1 / B_c, so that every class that is
    there counts the same.
    """
    alpha = torch.zeros_like(label)
    for member in of_classes(label):
        count = member.sum(dtype=label.dtype)
        weight = 1 / count.clamp(min=1) if weighting == "independent" else (1 - count / label.numel()) / label.numel()
        alpha = torch.where(member, weight, alpha)
    return alpha


def of_classes(label: Tensor) -> Iterator[Tensor]:
    """Which pixels (B, H, W) are free, unknown, occupied."""
    sign = label.sign()
    for value in CLASSES.values():
        yield sign == value


def class_sums(answer: Tensor, label: Tensor) -> Tensor:
    """(2, 3) float64: by class, the sum of (answer - label)², both in [-1, 1], and the pixels it is of. Sums of batches add up."""
    error = (answer - label).square().double()
    sums = [torch.stack((error[member].sum(), member.sum(dtype=torch.float64))) for member in of_classes(label)]
    return torch.stack(sums, dim=1)


def class_mse(sums: Tensor) -> dict[str, float]:
    """Mean squared error by class, pooled over all pixels, of added class_sums; NaN for a class that never occurred.

    Within [0, 4]; what says nothing, all logits 0, has 1 for free, 0 for unknown and 1 for occupied where labels are -1, 0 and 1.
    """
    return dict(zip(CLASSES, (sums[0] / sums[1]).tolist(), strict=True))


def calibrate(batches: Iterable[tuple[Tensor, Tensor]]) -> tuple[float, float]:
    """(a, b) so that a * logits + b are log-odds of occupied among the observed pixels, by greatest likelihood.

    `batches`: logits (B, H, W) and labels (B, H, W), from towns that the network has not learned from. A class-weighted loss tells occupied
    from free but shifts the odds by its weights; b undoes that, once per read-out and not once per look. (1, 0) where a class is missing.
    """
    pairs = [(logits[label != 0].double().numpy(), (label[label != 0] > 0).numpy()) for logits, label in batches]
    z, occupied = (np.concatenate(part) for part in zip(*pairs, strict=True))
    a, b = fit_logistic(np.stack((z, np.ones_like(z))), occupied, np.array([1.0, 0.0]))
    return float(a), float(b)
