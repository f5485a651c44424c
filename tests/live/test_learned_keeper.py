"""One run of the service begins with what the one before has learned, unless the configuration has changed."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.support import world

from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.live.learned_keeper import LearnedKeeper


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return load_config(world.write_drive(tmp_path, []) / "echogrid.toml")


def filter_of(config: Config) -> ErrorFilter:
    return ErrorFilter([radar.name for radar in config.radar])


def test_a_run_begins_with_what_the_one_before_has_learned(config: Config, tmp_path: Path) -> None:
    path, first, second = tmp_path / "map.learned.json", filter_of(config), filter_of(config)
    keeper = LearnedKeeper(path, config, first, threading.Lock())
    first.stood(10.0, 0.007)
    keeper.write()
    LearnedKeeper(path, config, second, threading.Lock())
    assert second.bias == pytest.approx(0.007, rel=0.01)
    grown = np.diag(second.covariance) - np.diag(first.covariance)
    assert (grown[3:] >= -1e-18).all()  # since then the errors have wandered
    assert not second.covariance[:3].any()


def test_with_another_mount_all_begins_anew(config: Config, tmp_path: Path) -> None:
    path, first, second = tmp_path / "map.learned.json", filter_of(config), filter_of(config)
    keeper = LearnedKeeper(path, config, first, threading.Lock())
    first.stood(10.0, 0.007)
    keeper.write()
    turned = (msgspec.structs.replace(config.radar[0], yaw_deg=1.0), *config.radar[1:])
    LearnedKeeper(path, msgspec.structs.replace(config, radar=turned), second, threading.Lock())
    assert second.bias == 0.0


def test_a_disk_that_cannot_be_written_is_logged_once(config: Config, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    keeper = LearnedKeeper(tmp_path / "gone" / "map.learned.json", config, filter_of(config), threading.Lock())
    with caplog.at_level(logging.WARNING):
        keeper.write()
        keeper.write()
    assert len(caplog.records) == 1


def test_a_damaged_file_does_not_stop_the_service_and_is_left_until_it_is_moved_away(
    config: Config, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, errors = tmp_path / "map.learned.json", filter_of(config)
    path.write_bytes(b'{"version":1,"car":')
    with caplog.at_level(logging.WARNING):
        keeper = LearnedKeeper(path, config, errors, threading.Lock())
        errors.stood(10.0, 0.007)
        keeper.write()
        keeper.write()
    assert path.read_bytes() == b'{"version":1,"car":'
    begun, kept = [record.getMessage() for record in caplog.records]
    assert begun.startswith(f"{path}: is not what echogrid learned of a car: ")
    assert kept == f"{path}: is not as this service left it, so what is learned of the car is not kept there"
    path.rename(tmp_path / "away")
    keeper.write()
    again = filter_of(config)
    LearnedKeeper(path, config, again, threading.Lock())
    assert again.bias == pytest.approx(0.007, rel=0.01)


def test_what_others_keep_there_is_not_replaced(config: Config, tmp_path: Path) -> None:
    """Another service of this store, or what many drives have taught, on a disk that comes late."""
    folder, errors, others = tmp_path / "disk", filter_of(config), filter_of(config)
    late = LearnedKeeper(folder / "map.learned.json", config, errors, threading.Lock())
    folder.mkdir()
    other = LearnedKeeper(folder / "map.learned.json", config, others, threading.Lock())
    others.stood(10.0, 0.007)
    other.write()
    late.write()
    other.write()  # which goes on
    late.write()
    kept = filter_of(config)
    LearnedKeeper(folder / "map.learned.json", config, kept, threading.Lock())
    assert kept.bias == pytest.approx(0.007, rel=0.01)
