"""What the two networks are shown, learn by, and mean."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from echogrid_training.learning.autoencoder import PaperAutoencoder
from echogrid_training.learning.dataset import Samples, of_lidar
from echogrid_training.learning.judging import held_out_loss
from echogrid_training.learning.recipe import IGNORED, Default, Paper, Recipe, shares
from echogrid_training.learning.unet import CLASS_WEIGHTS, UNet

SHARES = (0.6, 0.37, 0.03)
WAYS = (Paper(4, "independent", "ternary"), Paper(4, "inverse", "soft"), Paper(4, "inverse", "ternary", "lidar"), Default(SHARES))


def some(count: int = 6) -> Samples:
    """Every plane and every label of a sample is a function of the cell and of the plane's number."""
    rng = np.random.default_rng(1)
    labels = np.where(rng.uniform(size=(count, 128, 128)) < 0.3, 0, rng.integers(-127, 128, (count, 128, 128)))
    images = np.where(rng.uniform(size=(count, 12, 128, 128)) < 0.05, rng.integers(1, 256, (count, 12, 128, 128)), 0)
    return Samples(images.astype(np.uint8), rng.integers(0, 256, (count, 2048)).astype(np.uint8), labels.astype(np.int8))


def test_without_augmentation_all_are_shown_as_they_are() -> None:
    data = some()
    for way in WAYS:
        shown, label = way.shown(data)
        if isinstance(way, Default):
            np.testing.assert_allclose(shown, data.images / 255, atol=1e-7)
        elif way.sensor == "lidar":
            np.testing.assert_array_equal(shown, of_lidar(data.lidar))
        else:
            np.testing.assert_array_equal(shown[:, 0], np.where(data.images[:, 0] > 0, 1, -1))
        if isinstance(way, Paper) and way.labels == "soft":
            np.testing.assert_allclose(label, data.labels / 127, atol=1e-6)
        else:
            np.testing.assert_array_equal(label, np.sign(data.labels))
        assert shown.dtype == label.dtype == torch.float32


@pytest.mark.parametrize("way", WAYS)
def test_augmentation_moves_pairs_and_leaves_the_samples_alone(way: Recipe) -> None:
    """A label that marks what is drawn still does afterwards; and the same generator does the same."""
    data = some(20)
    lidar = np.unpackbits(data.lidar, axis=1).reshape(-1, 128, 128)
    drawn = lidar if isinstance(way, Paper) and way.sensor == "lidar" else data.images[:, 0]
    data = Samples(data.images, data.lidar, np.where(drawn > 0, 127, -127).astype(np.int8))
    before = data.digest()
    shown, label = way.shown(data, np.random.default_rng(3))
    again, _ = way.shown(data, np.random.default_rng(3))
    assert torch.equal((shown[:, 0] > 0), label > 0)
    assert torch.equal(shown, again)
    assert not torch.equal(shown, way.shown(data)[0])
    assert data.digest() == before


def test_each_way_has_its_network() -> None:
    for way in WAYS:
        network = way.network()
        assert isinstance(network, UNet if isinstance(way, Default) else PaperAutoencoder)
        shown, label = way.shown(some(2))
        output = network(shown)
        assert way.log_odds(output).shape == way.label(output).shape == label.shape
        assert way.loss(output, label).shape == ()
        assert (way.label(output).abs() <= 1).all()


def test_the_papers_answer_is_one_number_in_two_scales() -> None:
    output = torch.linspace(-6, 6, 7).view(1, 1, 7)
    odds = torch.exp(WAYS[0].log_odds(output))
    p = odds / (1 + odds)
    torch.testing.assert_close(WAYS[0].label(output), 2 * p - 1)


def test_the_defaults_loss_is_the_weighted_cross_entropy_cell_by_cell() -> None:
    """Classes are numbered from 0: free, unknown, occupied; cells that nobody judged do not count."""
    rng = np.random.default_rng(2)
    output, label = rng.normal(size=(2, 3, 4, 5)), rng.choice([-1, 0, 1, IGNORED], (2, 4, 5))
    total = weights = 0.0
    for n, i, j in np.argwhere(label != IGNORED):
        z, y = output[n, :, i, j], label[n, i, j] + 1
        total += CLASS_WEIGHTS[y] * (math.log(sum(math.exp(one) for one in z)) - z[y])
        weights += CLASS_WEIGHTS[y]
    found = Default(SHARES).loss(torch.tensor(output, dtype=torch.float32), torch.tensor(label, dtype=torch.float32))
    assert found.item() == pytest.approx(total / weights, rel=1e-5)


def test_the_defaults_log_odds_are_occupied_against_free_without_the_weights() -> None:
    output = torch.tensor((0.3, 2.0, 1.1)).view(1, 3, 1, 1)
    expected = (1.1 - math.log(2.3)) - (0.3 - math.log(0.35))
    assert Default(SHARES).log_odds(output).item() == pytest.approx(expected, rel=1e-5)


def test_shares_are_counted() -> None:
    labels = np.array([[[-100, -1, 0, 0], [127, 0, -3, 1]]], dtype=np.int8)
    assert shares(labels) == (3 / 8, 3 / 8, 2 / 8)
    assert shares(np.full((1, 2, 4), -5, np.int8)) == (1, 1 / 8, 1 / 8)  # what is missing counts as one cell: losses divide by it


def test_a_held_out_loss_is_the_sum_of_its_samples() -> None:
    """So two halves add up to the whole: nothing is added besides, and none counts twice."""
    data, way, model = some(3), Default(SHARES), UNet((4, 8))
    parts = [held_out_loss(way, model, data.chosen(np.array(which))) for which in ((0,), (1, 2), (0, 1, 2))]
    assert parts[2] > 0
    assert parts[0] + parts[1] == pytest.approx(parts[2], rel=1e-5)
