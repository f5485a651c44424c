"""The paper's autoencoder: shapes, size, and what its batch norms and decay touch."""

from __future__ import annotations

import math

import pytest
import torch
from torch import nn

from echogrid_training.learning.autoencoder import SLOPE, PaperAutoencoder, decayed, probe, weight_count


@pytest.mark.parametrize("width", [4, 8])
def test_an_image_gives_logits_of_its_size(width: int) -> None:
    model = PaperAutoencoder(width)
    assert model(probe(1, 60, batch=3)).shape == (3, 128, 128)
    assert model.encoder(probe(1, 60, batch=2)).shape == (2, 8 * width, 4, 4)


def test_width_16_has_the_size_that_is_said() -> None:
    assert weight_count(PaperAutoencoder(16)) == pytest.approx(0.87e6, rel=0.01)
    assert weight_count(PaperAutoencoder(32)) == pytest.approx(3.5e6, rel=0.01)


def test_every_layer_but_the_last_has_batch_norm_and_a_leaky_relu() -> None:
    model = PaperAutoencoder(4)
    for block in (*model.encoder, *model.decoder):
        conv, norm, slope = block.children()
        assert isinstance(conv, nn.Conv2d | nn.ConvTranspose2d)
        assert isinstance(norm, nn.BatchNorm2d)
        assert isinstance(slope, nn.LeakyReLU)
    assert isinstance(model.head, nn.Conv2d)


def test_decay_is_for_the_weights_of_convolutions_alone() -> None:
    model = PaperAutoencoder(4)
    weights, others = decayed(model)
    assert {weight.dim() for weight in weights} == {4}
    assert len(weights) == 11
    assert len(weights) + len(others) == len(list(model.parameters()))


def test_a_detection_near_the_car_reaches_the_whole_image() -> None:
    """Through the code of 4 x 4 cells: that is where a prior about places without detections can come from."""
    model = PaperAutoencoder(4).eval()
    image = probe(1, 0)
    other = image.clone()
    other[..., 62:66, 62:66] = 1.0
    with torch.inference_mode():
        changed = (model(image) - model(other))[0] != 0
    assert changed[0].any()
    assert changed[-1].any()
    assert changed[:, 0].any()
    assert changed[:, -1].any()


def test_weights_begin_as_he_has_it_for_what_comes_in() -> None:
    """Sixteen, or nine, of each channel that comes in: their variance times that number is 2 / (1 + slope^2)."""
    torch.manual_seed(1)
    for name, layer in PaperAutoencoder(8).named_modules():
        if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d):
            comes_in = layer.in_channels * layer.kernel_size[0] ** 2
            spread = layer.weight.std().item() ** 2 * comes_in
            assert spread == pytest.approx(2 / (1 + SLOPE**2), rel=6 / math.sqrt(layer.weight.numel())), name
