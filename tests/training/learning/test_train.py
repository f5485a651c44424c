"""What reaches the loop: augmentation, loss, weights' decay, each seen at its far end."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.support.rectangles import rectangles
from torch import Tensor, nn

from echogrid_training.learning import loss, recipe, train
from echogrid_training.learning.autoencoder import PaperAutoencoder
from echogrid_training.learning.dataset import Samples, of_detections, of_lidar
from echogrid_training.learning.recipe import Network, Paper, Sensor
from echogrid_training.learning.train import Run, Settings
from echogrid_training.learning.unet import UNet

SHORT = Settings("paper", epochs=2, seed=3, width=2, batch=4, rate=1e-3)


def ways(image: np.ndarray) -> list[bytes]:
    """The eight of the paper's augmentation, of (H, W)."""
    return [np.rot90(flipped, turn).tobytes() for flipped in (image, image[::-1]) for turn in range(4)]


@pytest.mark.parametrize("sensor", ["radar", "lidar"])
def test_the_network_learns_from_turned_images_beside_labels_turned_alike(
    sensor: Sensor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of rooms that look like none of their mirror images; what is validated on is shown as it is."""
    images, labels, validated = [], [], []
    forward, measure = PaperAutoencoder.forward, recipe.reconstruction_loss

    def drawn(samples: Samples) -> np.ndarray:
        return (of_lidar(samples.lidar) if sensor == "lidar" else of_detections(samples.images))[:, 0]

    def shown(model: PaperAutoencoder, image: Tensor) -> Tensor:
        (images if model.training else validated).extend(image[:, 0].numpy().copy())
        return forward(model, image)

    def compared(logits: Tensor, label: Tensor, weighting: loss.Weighting) -> Tensor:
        labels.extend(label.numpy().copy())
        return measure(logits, label, weighting)

    monkeypatch.setattr(PaperAutoencoder, "forward", shown)
    monkeypatch.setattr(recipe, "reconstruction_loss", compared)
    learned, held_out = rectangles(24, 1), rectangles(4, 2)
    learned = learned.chosen(np.array([i for i, one in enumerate(drawn(learned)) if len(set(ways(one))) == 8])[:20])
    train.fit(learned, held_out, replace(SHORT, sensor=sensor), tmp_path)

    pairs = {
        (image, label): way
        for one, of in zip(drawn(learned), np.sign(learned.labels).astype(np.float32), strict=True)
        for way, (image, label) in enumerate(zip(ways(one), ways(of), strict=True))
    }
    assert len(pairs) == 8 * 20
    found = [pairs[image.tobytes(), label.tobytes()] for image, label in zip(images, labels, strict=True)]
    assert len(found) == 40
    assert set(found) == set(range(8))
    assert {image.tobytes() for image in validated} == {image.tobytes() for image in drawn(held_out)}


def test_the_default_network_learns_from_both_sides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen, forward = [], UNet.forward

    def shown(model: UNet, image: Tensor) -> Tensor:
        if model.training:
            seen.extend(image[:, 0].numpy().copy())
        return forward(model, image)

    monkeypatch.setattr(UNet, "forward", shown)
    learned = rectangles(16, 1)
    train.fit(learned, rectangles(4, 2), replace(SHORT, network="default", epochs=1), tmp_path)
    plain = {(image[0] / np.float32(255)).tobytes() for image in learned.images}
    mirrored = {(image[0, ::-1] / np.float32(255)).tobytes() for image in learned.images}
    found = [image.tobytes() for image in seen]
    assert set(found) <= plain | mirrored
    assert set(found) & plain
    assert set(found) & mirrored


@pytest.mark.parametrize("weighting", ["inverse", "independent"])
def test_the_class_weights_that_are_asked_for_are_those_of_the_loss(
    weighting: loss.Weighting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the weights that the loss gives to pixels, at its innermost, for whatever reaches it from the settings."""
    given, weights = [], loss.pixel_weights
    monkeypatch.setattr(loss, "pixel_weights", lambda label, scheme: (given.append(scheme), weights(label, scheme))[1])
    train.fit(rectangles(8, 1), rectangles(2, 2), replace(SHORT, weighting=weighting), tmp_path)
    assert given == [weighting] * 4
    logits, label = torch.tensor([[[0.3, -2.0, 1.0, 0.5]]]), torch.tensor([[[-1.0, -1.0, 0.0, 1.0]]])
    alpha = torch.tensor([0.5, 0.5, 1.0, 1.0] if weighting == "independent" else [0.125, 0.125, 0.1875, 0.1875])
    expected = (alpha * (torch.tanh(logits / 2) - label) ** 2).sum()
    torch.testing.assert_close(Paper(2, weighting, "ternary").loss(logits, label), expected)


def test_settings_reach_the_recipe() -> None:
    for sensor in ("radar", "lidar"):
        for labels in ("ternary", "soft"):
            for weighting in ("inverse", "independent"):
                settings = Settings("paper", weighting, width=3, sensor=sensor, labels=labels)  # type: ignore[arg-type]
                way = train.recipe(settings, (0.6, 0.3, 0.1))
                assert isinstance(way, Paper)
                assert (way.width, way.weighting, way.labels, way.sensor) == (3, weighting, labels, sensor)


def without_gradient(settings: Settings, out: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[nn.Module, dict[str, Tensor]]:
    """The network as it begins, and its weights after a run whose loss is nothing but what L2 makes of it."""
    nothing: Callable[..., Any] = lambda self, output, _: 0.0 * output.sum()  # noqa: E731
    monkeypatch.setattr(recipe.Paper, "loss", nothing)
    monkeypatch.setattr(recipe.Default, "loss", nothing)
    train.fit(rectangles(8, 1), rectangles(2, 2), settings, out)
    began = Run(settings, train.recipe(settings, (0.6, 0.3, 0.1)), torch.device("cpu")).model
    held = torch.load(out / "checkpoint.pt", weights_only=True)["run"]["model"]
    return began, held


@pytest.mark.parametrize("network", ["paper", "default"])
def test_decay_shrinks_the_convolutions_weights_alone(network: Network, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By 1 - rate * decay in each step; batch norms and biases stay where they were."""
    settings = replace(SHORT, network=network, decay=5.0, rate=1e-2)
    began, ended = without_gradient(settings, tmp_path, monkeypatch)
    left = np.prod([1 - settings.decay * train.rate_at(step, 4, settings) for step in range(4)])
    assert left < 0.95
    kinds = set()
    for name, weight in began.named_parameters():
        kinds.add(weight.dim())
        torch.testing.assert_close(ended[name], weight.detach() * (left if weight.dim() == 4 else 1.0), msg=name)
    assert kinds == {1, 4}


def test_the_papers_l2_is_a_part_of_the_loss_and_for_all_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One step: Adam moves each weight by the rate towards 0, biases and batch norms too; and the loss that is noted is lambda sum w²."""
    settings = replace(SHORT, l2="loss", decay=0.5, epochs=1, batch=8, rate=1e-4)
    began, ended = without_gradient(settings, tmp_path, monkeypatch)
    moved = 0
    for name, weight in began.named_parameters():
        large = weight.detach().abs() > 1e-3
        expected = weight.detach() - 1e-4 * weight.detach().sign()
        torch.testing.assert_close(ended[name][large], expected[large], rtol=0, atol=2e-6, msg=name)
        moved += int(large.any()) if weight.dim() == 1 else 0
    assert moved >= 10  # batch norms' scales
    squares = sum(float((weight.detach().double() ** 2).sum()) for weight in began.parameters())
    (line,) = (tmp_path / "log.jsonl").read_text().splitlines()
    assert json.loads(line)["loss"] == pytest.approx(0.5 * squares, rel=1e-4)
