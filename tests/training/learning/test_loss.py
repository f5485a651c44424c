"""The loss against a slow loop over pixels, and errors and calibration against what they must be."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from echogrid_training.learning.loss import Weighting, calibrate, class_mse, class_sums, pixel_weights, reconstruction_loss

WEIGHTINGS: tuple[Weighting, ...] = ("inverse", "independent")


def example(seed: int = 0, occupied: float = 0.05, soft: bool = False) -> tuple[Tensor, Tensor]:
    """Logits and labels (3, 12, 12), unlike from patch to patch."""
    rng = np.random.default_rng(seed)
    label = rng.choice((-1.0, 0.0, 1.0), size=(3, 12, 12), p=(0.6 - occupied, 0.4, occupied))
    label[0][label[0] == 1] = 0  # a patch without anything occupied
    if soft:
        label *= rng.uniform(0.1, 1.0, label.shape)
    return torch.tensor(rng.normal(0.0, 2.0, label.shape), dtype=torch.float32), torch.tensor(label, dtype=torch.float32)


def by_pixel(logits: Tensor, label: Tensor, weighting: Weighting) -> float:
    """The paper's formulas, a pixel at a time."""
    pixels = list(zip(logits.flatten().tolist(), label.flatten().tolist(), strict=True))
    total = 0.0
    for z, y in pixels:
        same = sum(math.copysign(bool(y), y) == math.copysign(bool(other), other) for _, other in pixels)
        alpha = 1 / same if weighting == "independent" else (1 - same / len(pixels)) / len(pixels)
        total += alpha * (math.tanh(z / 2) - y) ** 2
    return total


@pytest.mark.parametrize("weighting", WEIGHTINGS)
@pytest.mark.parametrize("soft", [False, True])
def test_loss_is_the_sum_over_pixels(weighting: Weighting, soft: bool) -> None:
    logits, label = example(soft=soft)
    assert reconstruction_loss(logits, label, weighting).item() == pytest.approx(by_pixel(logits, label, weighting), rel=1e-5)


def test_independent_weights_add_the_mse_of_the_classes() -> None:
    logits, label = example()
    mse = class_mse(class_sums(torch.tanh(logits / 2), label))
    assert reconstruction_loss(logits, label, "independent").item() == pytest.approx(sum(mse.values()), rel=1e-5)


def test_inverse_weights_halve_all_but_a_rare_class() -> None:
    """The paper's approximation: alpha near 1 for the occupied, near 1/2 for the others."""
    label = torch.cat((-torch.ones(500), torch.zeros(500), torch.ones(5))).view(1, 1, -1)
    alpha = pixel_weights(label, "inverse") * label.numel()
    assert alpha[label == 1].tolist() == pytest.approx([1.0] * 5, abs=0.01)
    assert alpha[label != 1].tolist() == pytest.approx([0.5] * 1000, abs=0.01)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_a_class_that_is_not_there_does_no_harm(weighting: Weighting) -> None:
    logits, label = example(occupied=0.0)
    logits.requires_grad_()
    loss = reconstruction_loss(logits, label, weighting)
    torch.autograd.backward(loss)
    assert loss.item() == pytest.approx(by_pixel(logits.detach(), label, weighting), rel=1e-5)
    assert logits.grad is not None
    assert torch.isfinite(logits.grad).all()
    assert math.isnan(class_mse(class_sums(torch.tanh(logits.detach() / 2), label))["occupied"])


def test_errors_by_class_are_pooled_over_batches() -> None:
    logits, label = example(1)
    answer = torch.tanh(logits / 2)
    whole = class_mse(class_sums(answer, label))
    parts = class_mse(sum((class_sums(answer[i : i + 1], label[i : i + 1]) for i in range(3)), torch.zeros(2, 3)))
    assert parts == pytest.approx(whole)
    pixels = list(zip(logits.flatten().tolist(), label.flatten().tolist(), strict=True))
    for name, value in (("free", -1), ("unknown", 0), ("occupied", 1)):
        errors = [(math.tanh(z / 2) - y) ** 2 for z, y in pixels if y == value]
        assert whole[name] == pytest.approx(sum(errors) / len(errors), rel=1e-5)


def test_saying_nothing_costs_one_where_something_is() -> None:
    _, label = example()
    assert class_mse(class_sums(torch.zeros_like(label), label)) == {"free": 1.0, "unknown": 0.0, "occupied": 1.0}


def test_calibration_finds_scale_and_shift() -> None:
    """Labels drawn with log-odds 0.7 z - 2: that is what must come back, whatever the unknown pixels hold."""
    generator = torch.Generator().manual_seed(1)
    logits = 3 * torch.randn(8, 100, 100, generator=generator)
    label = 2.0 * (torch.rand(logits.shape, generator=generator) < torch.sigmoid(0.7 * logits - 2)) - 1
    label[:, :20] = 0
    a, b = calibrate([(logits[:4], label[:4]), (logits[4:], label[4:])])
    assert a == pytest.approx(0.7, abs=0.03)
    assert b == pytest.approx(-2.0, abs=0.06)


def test_calibration_stays_finite() -> None:
    label = torch.tensor((-1.0, -1.0, 1.0)).view(1, 1, 3)
    assert all(math.isfinite(value) for value in calibrate([(10 * label, label)]))
    assert calibrate([(label, -torch.ones_like(label))]) == (1.0, 0.0)
