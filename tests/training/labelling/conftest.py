"""A simulated reference car with its lidar in a bag, brought and labelled once for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from echogrid_training import cli


@pytest.fixture(scope="session")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive folder of 8 s with truth.npz, lidar.mcap and lidar.toml: sensors as no network has met them, a poor dead reckoning."""
    out = tmp_path_factory.mktemp("cars")
    arguments = ["--family", "train", "--towns", "1", "--seconds", "8", "--seed", "5", "--workers", "1"]
    assert cli.main(["simulate", *arguments, "--lidar", "--out", str(out)]) == 0
    return out / "train-00000"


def bring(car: Path, lidar: Path, out: Path, mount: Path | None = None) -> int:
    arguments = [
        str(car / "can.log.gz"),
        "-c",
        str(car / "echogrid.toml"),
        "--lidar",
        str(lidar),
        "--mount",
        str(mount or car / "lidar.toml"),
    ]
    return cli.main(["import", "own", *arguments, "--out", str(out)])


@pytest.fixture(scope="session")
def labelled(car: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same drive by its CAN log and its bag alone."""
    out = tmp_path_factory.mktemp("own") / "mine"
    assert bring(car, car / "lidar.mcap", out) == 0
    assert cli.main(["label", str(out)]) == 0
    return out
