"""The default network after two short epochs, and its files: learned once for all tests that need one."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support.rectangles import rectangles

from echogrid.core.map.look_map import Calibration
from echogrid_training.learning.export import export
from echogrid_training.learning.train import Settings, Trained, fit

READ_OUT = Calibration(1.5, -1.0)


@pytest.fixture(scope="session")
def unet(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trained, Path]:
    """What was learned from rectangles, and the folder of the run."""
    out = tmp_path_factory.mktemp("unet")
    settings = Settings("default", epochs=2, seed=5, batch=2, per_epoch=20, rate=1e-2)
    return fit(rectangles(40, 1), rectangles(8, 2), settings, out), out


@pytest.fixture(scope="session")
def unet_files(unet: tuple[Trained, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """default.onnx and default.int8.onnx by name; int8 with steps by 16 rooms of its own."""
    paths = export(unet[0], tmp_path_factory.mktemp("files"), READ_OUT, rectangles(16, 3).images)
    return {path.name: path for path in paths}
