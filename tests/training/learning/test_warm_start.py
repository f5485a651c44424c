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


def test_another_networks_file_is_refused(tmp_path: Path) -> None:
    paper = Path(export.__file__).parents[3] / "service" / "echogrid" / "models" / "paper.onnx"
    with pytest.raises(EchogridError, match=r"weights core\.stem\.0\.0\.weight: found none, expected \(32, 48, 3, 3\); give a float file"):
        warm_start.started(paper, SAMPLES)
