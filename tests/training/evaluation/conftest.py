"""A drive through a room, four seconds long, and a network that finds its way in there."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.support import tiny_drives
from tests.support.networks import SHARES, default, write
from tests.support.tiny_towns import track

from echogrid_training.evaluation.simulated.tape import Tape, load_tape


@pytest.fixture(scope="session")
def room_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("room") / "drive"
    return tiny_drives.room_drive(folder, track(4.0, speed=3.5, x=-7.0), length=30.0)


@pytest.fixture(scope="session")
def room_tape(room_drive: Path) -> Tape:
    return load_tape(room_drive)


@pytest.fixture(scope="session")
def network_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What was hit often is occupied, what was looked at and not hit is free."""
    graph, contract = default(128, 30.0 / 128)
    return write(tmp_path_factory.mktemp("network") / "tiny.onnx", graph, contract | {"class_shares": SHARES})
