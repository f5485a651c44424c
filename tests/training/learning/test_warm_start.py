"""A network that goes on from a file answers as the file does, in training too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.rectangles import rectangles
from torch import nn

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration
from echogrid.errors import EchogridError
from echogrid.model.network import OnnxSensorModel
from echogrid_training.learning import export, warm_start
from echogrid_training.learning.train import Settings, Trained
from echogrid_training.learning.unet import UNet, corrected

SAMPLES = rectangles(12, 3)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a network whose norms are not at their start."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(5)
        model = UNet()
        for norm in model.modules():
            if isinstance(norm, nn.BatchNorm2d):
                nn.init.uniform_(norm.weight, 0.5, 1.5)
                nn.init.normal_(norm.bias, 0.0, 0.3)
                norm.running_mean.normal_(0.0, 0.2)  # type: ignore[union-attr]
                norm.running_var.uniform_(0.5, 2.0)  # type: ignore[union-attr]
        nn.init.normal_(model.core.head.weight, std=0.2)
    trained = Trained(
        Settings(seed=5), model.eval().state_dict(), "ab" * 32, (1.0, 0.0), torch.from_numpy(SAMPLES.images[:3]), (0.6, 0.37, 0.03)
    )
    return export.export(trained, tmp_path_factory.mktemp("start"), Calibration())[0]


def test_it_answers_as_the_file_does(file: Path) -> None:
    """ONNX Runtime against PyTorch."""
    model, other = UNet(), OnnxSensorModel(file, GridSpec(), {})
    model.load_state_dict(warm_start.started(file, SAMPLES))
    model.eval()
    for image in SAMPLES.images[:4]:
        with torch.no_grad():
            answer = corrected(model(torch.from_numpy(image[None]).float() / 255))[0].numpy()
        np.testing.assert_allclose(answer, other.run(image), atol=1e-4)


def test_the_norms_hold_the_statistics_of_what_is_shown(file: Path) -> None:
    """So the first steps of training, which norm by the batch, begin where the file left off."""
    model = UNet()
    model.load_state_dict(warm_start.started(file, SAMPLES))
    shown = torch.from_numpy(SAMPLES.images).float() / 255
    with torch.no_grad():
        still = model.eval()(shown)
        learning = model.train()(shown)
    torch.testing.assert_close(learning, still, atol=1e-3, rtol=1e-3)


def test_between_two_files_that_differ_in_the_last_layer_answers_lie_between_theirs(file: Path, tmp_path: Path) -> None:
    """The last layer is linear, so there, and only there, the mean of weights is the mean of answers."""
    weights = warm_start.started(file, SAMPLES)
    weights["core.head.weight"] = weights["core.head.weight"] * 1.7 - 0.1
    weights["core.head.bias"] = weights["core.head.bias"] + 0.4
    trained = Trained(Settings(seed=5), weights, "ab" * 32, (1.0, 0.0), torch.from_numpy(SAMPLES.images[:3]), (0.6, 0.37, 0.03))
    other = export.export(trained, tmp_path, Calibration())[0]
    first, second = (OnnxSensorModel(path, GridSpec(), {}) for path in (file, other))
    shown = torch.from_numpy(SAMPLES.images[:2]).float() / 255
    for keep in (0.0, 0.25, 1.0):
        model = UNet()
        model.load_state_dict(warm_start.between(file, other, keep, SAMPLES))
        with torch.no_grad():
            answers = corrected(model.eval()(shown)).numpy()
        for answer, image in zip(answers, SAMPLES.images, strict=False):
            np.testing.assert_allclose(answer, keep * first.run(image) + (1 - keep) * second.run(image), atol=1e-3)


def test_another_networks_file_is_refused(tmp_path: Path) -> None:
    paper = Path(export.__file__).parents[3] / "service" / "echogrid" / "models" / "paper.onnx"
    with pytest.raises(EchogridError, match=r"weights core\.stem\.0\.0\.weight: found none, expected \(32, 48, 3, 3\); give a float file"):
        warm_start.started(paper, SAMPLES)
