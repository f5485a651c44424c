"""What a network learns from towns that are seen as a car sees streets: a loss that minds no cell without a label, and the best weights."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from tests.support import posts
from tests.support.rectangles import rectangles

from echogrid.config.loading import load_config
from echogrid.core.evidence.raster import GridSpec
from echogrid.model.network import KEY, OnnxSensorModel
from echogrid_training import cli
from echogrid_training.learning.dataset import UNJUDGED, Samples, ternary
from echogrid_training.learning.judging import held_out_loss
from echogrid_training.learning.recipe import Default, shares
from echogrid_training.learning.train import Settings, fit
from echogrid_training.own import half as half_module
from echogrid_training.own import patches as patches_module


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


def test_a_network_of_this_car(street: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """By stretches that a drive of 15 m has enough of."""
    monkeypatch.setattr(half_module, "STRETCH", 4.0)
    monkeypatch.setattr(patches_module, "GUARD", 0.5)
    towns, out = tmp_path / "towns", tmp_path / "mine.onnx"
    simulate = ["simulate", "--family", "train", "--towns", "2", "--seconds", "5", "--seed", "5", "--workers", "1"]
    assert cli.main([*simulate, "--like", str(street), "--out", str(towns)]) == 0
    for town in ("train-00000", "train-00001"):
        mounts = {radar.name: (radar.x, radar.y) for radar in load_config(towns / town / "echogrid.toml").radar}
        assert mounts == {name: (mount.x, mount.y) for name, mount in posts.MOUNTS.items()}
    assert cli.main(["adapt", "default", str(street), "--simulated", str(towns), "--epochs", "1", "--out", str(out)]) == 0
    assert "| before | last step | weights and last step |" in capsys.readouterr().out
    held = json.loads(next(one.value for one in onnx.load(out).metadata_props if one.key == KEY))
    assert held["drives"][0]["name"] == "street"
    assert held["before"]["detections"] == held["after"]["detections"] > 0
    OnnxSensorModel(out, GridSpec(), {})
    (towns / "train-00001").rename(tmp_path / "elsewhere")
    assert cli.main(["adapt", "default", str(street), "--simulated", str(towns), "--out", str(out)]) == 1
    assert "towns: holds one town, expected two or more: one to learn from, one to stop by" in capsys.readouterr().err
    assert cli.main([*simulate, "--sensors", "drawn", "--out", str(towns)]) == 1
    assert "campaign.json: the folder holds a campaign with other radars (--like), expected the same drives" in capsys.readouterr().err
