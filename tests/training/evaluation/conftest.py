"""A drive through a room, four seconds long, and a network that finds its way in there."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support.networks import SHARES, default, write
from tests.support.tiny_towns import room, town, track

from echogrid_training.drives.drive import write_drive
from echogrid_training.drives.simulate import simulate
from echogrid_training.evaluation.simulated.tape import Tape, load_tape
from echogrid_training.sensors.episode import paper_like


@pytest.fixture(scope="session")
def room_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("room") / "drive"
    recording, truth = simulate(town(*room(30.0, 14.0), ego=track(4.0, speed=3.5, x=-7.0)), paper_like(2))
    write_drive(recording, folder, truth_map=truth)
    return folder


@pytest.fixture(scope="session")
def room_tape(room_drive: Path) -> Tape:
    return load_tape(room_drive)


@pytest.fixture(scope="session")
def network_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What was hit often is occupied, what was looked at and not hit is free."""
    graph, contract = default(128, 30.0 / 128)
    return write(tmp_path_factory.mktemp("network") / "tiny.onnx", graph, contract | {"class_shares": SHARES})
