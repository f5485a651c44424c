"""Copies of one tiny drive to learn from and to judge by, and settings that take no time."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.support.tiny_drives import room_drive
from tests.support.tiny_towns import track

from echogrid_training.learning import train
from echogrid_training.learning.train import Settings


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """learn/a, learn/b and test/c."""
    folder = tmp_path_factory.mktemp("drives")
    room_drive(folder / "learn" / "a", track(1.5, speed=4.0, x=-5.0, y=2.0, yaw=0.1))
    for name in ("learn/b", "test/c"):
        shutil.copytree(folder / "learn" / "a", folder / name)
    return folder


@pytest.fixture(scope="module")
def tiny() -> Iterator[None]:
    """--small is tiny here."""

    def small(network: Any, weighting: Any, seed: int) -> Settings:
        return Settings(network, weighting, 1, seed, width=4, batch=2)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(train, "small", small)
        yield
