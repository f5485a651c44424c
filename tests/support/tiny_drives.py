"""Drives through tiny towns, as the simulator writes them."""

from __future__ import annotations

from pathlib import Path

from tests.support.tiny_towns import room, town

from echogrid_training.drives.drive import write_drive
from echogrid_training.drives.simulate import simulate
from echogrid_training.sensors.episode import paper_like
from echogrid_training.towns.town import Track


def room_drive(folder: Path, ego: Track, length: float = 28.0, width: float = 14.0, seed: int = 2) -> Path:
    """Through a room, into a folder, with its true map; the folder."""
    recording, truth = simulate(town(*room(length, width), ego=ego), paper_like(seed))
    write_drive(recording, folder, truth_map=truth)
    return folder
