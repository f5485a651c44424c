"""What is learned from drives: labels by their chances, two kinds that share nothing, and a loss that minds no cell without one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from tests.support.rectangles import rectangles

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.model.network import KEY, OnnxSensorModel
from echogrid_training import cli
from echogrid_training.evaluation.recorded.drive import hear
from echogrid_training.learning.dataset import SURE, UNJUDGED, Samples, ternary
from echogrid_training.learning.judging import held_out_loss
from echogrid_training.learning.recipe import Default, shares
from echogrid_training.learning.train import Settings, fit
from echogrid_training.own import fine_tuning
from echogrid_training.own import half as half_module
from echogrid_training.own import patches as patches_module
from echogrid_training.own.fine_tuning import hindsight_samples, label_of
from echogrid_training.own.hindsight import Judged


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stretches that a drive of 15 m has enough of."""
    monkeypatch.setattr(half_module, "STRETCH", 4.0)
    monkeypatch.setattr(patches_module, "GUARD", 0.5)
    monkeypatch.setattr(fine_tuning, "LEAST", 20)


def test_labels_come_as_often_as_their_chance_says() -> None:
    chance = np.full((300, 300), np.nan, np.float32)
    chance[:, :150], chance[:, 150:200] = 0.25, 0.9
    judged = Judged(np.zeros((300, 300), np.int8), chance)
    cell = GridSpec().cell
    ego = EgoState(0, SE2(150.2 * cell, 150.2 * cell, 0.0), 0.0, 0.0)
    label = label_of(judged, ego, 0, 0, np.random.default_rng(1))
    assert set(np.unique(label)) == {SURE, -SURE, UNJUDGED}
    np.testing.assert_allclose([(label[:, :63] > 0).mean(), (label[:, 65:113] > 0).mean()], (0.25, 0.9), atol=0.02)
    assert (label[:, 115:] == UNJUDGED).all()


@pytest.mark.usefixtures("short")
def test_samples_of_a_street(street: Path) -> None:
    learned, held_out = hindsight_samples([hear(street)], 3)
    assert len(learned) > 4
    assert len(held_out) > 2
    for part in (learned, held_out):
        assert part.images.any(axis=(1, 2, 3)).all()
        assert ((part.labels > 0) | (part.labels == -SURE) | (part.labels == UNJUDGED)).all()
        middle = part.labels[:, 60:68, 60:68]  # under the car: driven over, or of the other kind
        assert (middle[middle != UNJUDGED] < 0).mean() > 0.98
    again, _ = hindsight_samples([hear(street)], 3)
    assert again.digest() == learned.digest()


def test_cells_without_a_label_teach_nothing() -> None:
    way, samples = Default((0.6, 0.3, 0.1)), rectangles(2, 1)
    output = torch.randn(2, 3, 128, 128, generator=torch.Generator().manual_seed(1), requires_grad=True)
    labels = samples.labels.copy()
    labels[:, 30:90] = UNJUDGED
    some = Samples(samples.images, samples.lidar, labels)
    way.loss(output, way.shown(some)[1]).backward()
    assert output.grad is not None
    assert not output.grad[:, :, 30:90].any()
    assert output.grad[:, :, :30].abs().sum() > 0
    assert not ternary(labels)[:, 30:90].any()
    kept = labels[labels != UNJUDGED]
    np.testing.assert_allclose(shares(labels), [(kept < 0).mean(), (kept == 0).mean(), (kept > 0).mean()])


def test_the_best_weights_are_kept(tmp_path: Path) -> None:
    """Steps far too long make it worse: what it started from stays. Good ones make it better."""
    learned, held_out = rectangles(12, 1), rectangles(4, 2)
    start = fit(learned, held_out, Settings("default", epochs=2, seed=1, batch=4, rate=5e-3), tmp_path / "start").weights
    way = Default(shares(learned.labels))

    def loss(weights: dict[str, torch.Tensor]) -> float:
        model = way.network()
        model.load_state_dict(weights)
        return held_out_loss(way, model.eval(), held_out)

    wild = Settings("default", epochs=3, seed=1, batch=4, rate=3.0, warm=0.0)
    kept = fit(learned, held_out, wild, tmp_path / "wild", start=start, patience=2).weights
    assert loss(kept) <= loss(start)
    better = fit(learned, held_out, Settings("default", epochs=2, seed=1, batch=4, rate=2e-3), tmp_path / "better", start=start, patience=2)
    assert loss(better.weights) < loss(start)


@pytest.mark.usefixtures("short")
def test_a_network_of_this_car(street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "mine.onnx"
    assert cli.main(["adapt", "default", str(street), "--epochs", "1", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "| before | last step | weights and last step |" in said
    held = json.loads(next(one.value for one in onnx.load(out).metadata_props if one.key == KEY))
    assert held["drives"][0]["name"] == "street"
    assert held["before"]["detections"] == held["after"]["detections"] > 0
    OnnxSensorModel(out, GridSpec(), {})
