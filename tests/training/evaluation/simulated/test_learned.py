"""An autoencoder that is shown the lidar's image, beside those of the radars'."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.rectangles import rectangles

from echogrid.errors import EchogridError
from echogrid_training.evaluation.simulated.learned import File, LidarNetwork, lidar_networks, networks
from echogrid_training.evaluation.simulated.patches import patches
from echogrid_training.evaluation.simulated.tape import load_tape
from echogrid_training.learning.train import Settings, Trained, fit


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Trained, Path]:
    out = tmp_path_factory.mktemp("lidar")
    settings = Settings("paper", epochs=1, width=2, batch=4, per_epoch=8, sensor="lidar")
    return fit(rectangles(8, 1), rectangles(4, 2), settings, out), out


def test_it_is_shown_the_lidars_returns_and_nothing_of_the_radars(trained: tuple[Trained, Path], room_drive: Path) -> None:
    network = LidarNetwork(File("lidar", trained[1] / "model.pt"))
    patch = next(patches(load_tape(room_drive), 1))
    assert patch.lidar.any()
    said = network.answer(replace(patch, image=np.zeros_like(patch.image))).scores
    shown = torch.full((1, 1, 128, 128), -1.0)
    shown[0, 0][torch.from_numpy(patch.lidar > 0)] = 1.0
    np.testing.assert_allclose(said, trained[0].model()(shown)[0].numpy(), atol=1e-5)
    occupied = patch.place.truth > 0
    assert occupied[patch.lidar > 0].mean() > 10 * occupied.mean()  # its returns lie where the truth is occupied


def test_it_is_apart_from_what_the_service_can_run(trained: tuple[Trained, Path], network_file: Path) -> None:
    files = [File("lidar", trained[1] / "model.pt"), File("tiny", network_file)]
    assert set(networks(files, {})) == {("tiny", 0)}
    assert set(lidar_networks(files)) == {("lidar", 0)}


def test_a_radars_network_is_refused(tmp_path: Path) -> None:
    fit(rectangles(4, 1), rectangles(4, 2), Settings("paper", epochs=1, width=2, batch=4, per_epoch=4), tmp_path)
    with pytest.raises(EchogridError, match=r"model\.pt: is a network of the radar's image, expected the lidar's"):
        LidarNetwork(File("lidar", tmp_path / "model.pt"))
