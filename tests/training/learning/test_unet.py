"""The default network: its size and folding, and what its three classes are worth as one answer."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn.functional import cross_entropy, pixel_shuffle, pixel_unshuffle

from echogrid.model.network import folded, unfolded
from echogrid_training.learning.autoencoder import weight_count
from echogrid_training.learning.unet import CLASS_WEIGHTS, UNet, corrected, evenly

TINY = (8, 8, 8)


def test_twelve_planes_give_three_logits_for_every_cell() -> None:
    assert UNet(TINY)(torch.rand(2, 12, 128, 128)).shape == (2, 3, 128, 128)
    assert UNet(TINY).core(torch.rand(1, 48, 64, 64)).shape == (1, 12, 64, 64)


def test_it_has_the_size_that_fits_the_cycle() -> None:
    assert weight_count(UNet()) == pytest.approx(0.41e6, rel=0.01)


def test_every_layer_has_an_int8_kernel() -> None:
    kinds = {type(layer) for layer in UNet().modules() if not list(layer.children())}
    assert kinds == {nn.Conv2d, nn.BatchNorm2d, nn.ReLU}


def test_numpy_folds_and_unfolds_as_torch_does() -> None:
    """The service folds what training does not: both must agree on which cell goes where."""
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (12, 16, 24)).astype(np.uint8)
    np.testing.assert_array_equal(folded(image), pixel_unshuffle(torch.from_numpy(image)[None].float(), 2)[0].numpy())
    planes = rng.normal(size=(12, 8, 12)).astype(np.float32)
    np.testing.assert_array_equal(unfolded(planes), pixel_shuffle(torch.from_numpy(planes)[None], 2)[0].numpy())
    np.testing.assert_array_equal(unfolded(folded(image).astype(np.float32)), image)


def test_the_network_is_its_core_between_folding_and_unfolding() -> None:
    model = UNet(TINY).eval()
    image = np.random.default_rng(2).integers(0, 256, (12, 128, 128)).astype(np.uint8)
    with torch.inference_mode():
        whole = model(torch.from_numpy(image)[None].float() / 255)[0].numpy()
        core = model.core(torch.from_numpy(folded(image))[None].float() / 255)[0].numpy()
    np.testing.assert_allclose(unfolded(core), whole, atol=1e-6)


def test_a_detection_reaches_far_and_its_own_cell_most() -> None:
    """Down to 8 cells a side and up again, beside the skips."""
    torch.manual_seed(1)
    model = UNet().eval()
    image = torch.zeros(1, 12, 128, 128)
    other = image.clone()
    other[:, :, 64, 64] = 1.0
    with torch.inference_mode():
        change = (model(image) - model(other)).abs().amax(dim=(0, 1))
    assert change.argmax() // 128 in range(60, 69)
    assert change.argmax() % 128 in range(60, 69)
    assert change[64, 100] > 0


def test_even_classes_get_the_least_squared_error_that_a_constant_can_have() -> None:
    """Three kinds of evidence, each met with other shares of free, unknown and occupied. For each, all answers from -1 to 1 are tried
    against the squared error in which the three classes weigh the same."""
    joint = np.array([(0.50, 0.10, 0.01), (0.12, 0.15, 0.02), (0.02, 0.03, 0.05)])  # p(evidence, class)
    shares = joint.sum(axis=0)
    answers = np.linspace(-1, 1, 20_001)
    logits = torch.tensor(np.log(joint / joint.sum(axis=1, keepdims=True))).view(1, 3, 3, 1).transpose(1, 2)  # (1, class, evidence, 1)
    found = evenly(logits, torch.tensor(shares))[0, :, 0].numpy()
    for given, answer in zip(joint, found, strict=True):
        errors = sum(p / share * (answers - label) ** 2 for p, share, label in zip(given, shares, (-1, 0, 1), strict=True))
        assert answer == pytest.approx(answers[np.argmin(errors)], abs=1e-4)


def test_what_is_said_evenly_is_the_class_mse_at_its_best() -> None:
    """No other answer to the same three kinds of evidence has a smaller sum of mean squared errors by class."""
    rng = np.random.default_rng(1)
    joint = rng.dirichlet(np.ones(9)).reshape(3, 3)
    shares = joint.sum(axis=0)
    logits = torch.tensor(np.log(joint)).view(1, 3, 3, 1).transpose(1, 2)
    found = evenly(logits, torch.tensor(shares))[0, :, 0].numpy()

    def class_mse(answers: np.ndarray) -> float:
        return float((joint / shares * (answers[:, None] - (-1, 0, 1)) ** 2).sum())

    for _ in range(200):
        assert class_mse(found) < class_mse(found + rng.normal(0, 0.1, 3))


def test_the_losss_weights_are_taken_out_again() -> None:
    """A network that can say but one thing learns the weighted shares; what is left after correction are the shares themselves."""
    label = torch.tensor([0] * 500 + [1] * 470 + [2] * 30)
    logits = torch.zeros(1, 3, requires_grad=True)
    optimiser = torch.optim.LBFGS([logits], max_iter=200, tolerance_grad=1e-10, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        value = cross_entropy(logits.expand(1000, 3), label, weight=torch.tensor(CLASS_WEIGHTS))
        value.backward()
        return value

    optimiser.step(loss)
    weighted = np.array((500, 470, 30)) * CLASS_WEIGHTS
    said = logits.detach().view(1, 3, 1, 1)
    np.testing.assert_allclose(said.softmax(dim=1).flatten(), weighted / weighted.sum(), atol=1e-4)
    np.testing.assert_allclose(corrected(said).softmax(dim=1).flatten(), (0.5, 0.47, 0.03), atol=1e-4)
