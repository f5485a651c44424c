"""Samples: the service's own images beside the truth at the same place."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.support import networks
from tests.support.tiny_drives import room_drive
from tests.support.tiny_towns import track

from echogrid.config.loading import load_config
from echogrid.core.evidence.history_raster import CHANNELS
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.motion.se2 import SE2
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.model.network import OnnxSensorModel
from echogrid.pipeline import Pipeline
from echogrid_training.drives.samples import SPACING, Sample, samples
from echogrid_training.sensors.disturbance import Disturbance
from echogrid_training.truth.ground_truth import ternary

SPEC = GridSpec()
START = SE2(-6.0, 2.0, 0.1)  # in a room of 28 x 14 m: no two of its walls are equally far, so no image looks like its mirror image


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples") / "drive"
    return room_drive(folder, track(3.0, speed=3.0, x=START.x, y=START.y, yaw=START.yaw))


@pytest.fixture(scope="module")
def found(drive: Path) -> list[Sample]:
    return list(samples(drive))


def near_walls(sample: Sample, drawn: np.ndarray, cells: int) -> list[bool]:
    walls = np.argwhere(ternary(sample.truth) == 1)
    return [bool(np.abs(walls - cell).max(axis=1).min() <= cells) for cell in np.argwhere(drawn)]


def test_detections_lidar_and_truth_show_the_same_walls(found: list[Sample]) -> None:
    """Most of what is drawn lies within a cell or two of a true wall: same frame, same rows and columns, same signs."""
    now, past, lidar = [], [], []
    for sample in found:
        assert sample.image.shape == (12, SPEC.cells, SPEC.cells)
        assert sample.image.dtype == np.uint8
        assert set(np.unique(sample.lidar)) == {0, 1}
        now += near_walls(sample, sample.image[0], 2)
        past += near_walls(sample, sample.image[CHANNELS.index("count_15m")], 2)
        lidar += near_walls(sample, sample.lidar * (sample.image[CHANNELS.index("looks_15m")] > 0), 1)  # of the rest no radar can tell
    assert len(now) > 100
    assert len(past) > 5 * len(now)
    assert np.mean(now) > 0.8
    assert np.mean(past) > 0.8
    assert len(lidar) > 1000
    assert np.mean(lidar) > 0.95


def on_walls(sample: Sample, drawn: np.ndarray, reach: float) -> list[bool]:
    """Whether each drawn cell (H, W) lies within `reach` m of a wall, by the town's own plan."""
    x, y = np.abs((START @ sample.truth_from_base).apply(SPEC.centres()[drawn.astype(bool)])).T
    return (np.minimum(np.abs(x - 14.0), np.abs(y - 7.0)) < reach).tolist()


def test_each_of_them_shows_the_walls_where_the_town_has_them(found: list[Sample]) -> None:
    """Each for itself: turned over together they would still agree with each other."""
    drawn = {"truth": (lambda sample: sample.truth > 0, 0.3), "lidar": (lambda sample: sample.lidar, 0.3)}
    drawn |= {name: (lambda sample, name=name: sample.image[CHANNELS.index(name)], 0.6) for name in ("now", "count_15m")}
    for name, (cells, reach) in drawn.items():
        there = [one for sample in found for one in on_walls(sample, cells(sample), reach)]
        assert len(there) > 100, name
        assert np.mean(there) > (0.95 if reach < 0.5 else 0.8), name
    for sample in found:  # of the five that can be seen in every patch, the two beside the car
        rows = SPEC.centres()[..., 1][(sample.truth > 0) & (np.abs(SPEC.centres()[..., 0]) < 2.0)]
        assert 3.0 < rows.max() < 6.0
        assert -11.0 < rows.min() < -8.0


def test_samples_keep_their_distance(drive: Path, found: list[Sample]) -> None:
    """Nine metres are driven; the first update has a pose only a little after the start."""
    for one, other in pairwise(found):
        there, here = other.truth_from_base, one.truth_from_base
        assert SPACING <= math.hypot(there.x - here.x, there.y - here.y) < SPACING + 0.5
        assert other.stamp_ns > one.stamp_ns
    assert len(found) in (8, 9)
    assert len(list(samples(drive, spacing=3.0))) == 3


def test_images_are_those_that_the_service_shows_its_network(drive: Path, found: list[Sample], tmp_path: Path) -> None:
    """The drive again, by a service that runs a network: byte for byte what it is asked about at the same time."""
    net = networks.write(tmp_path / "net.onnx", *networks.default(SPEC.cells, SPEC.cell))
    config = load_config(drive / "echogrid.toml", str(net))
    pipeline = Pipeline(config, drive / "echogrid.toml")
    model = OnnxSensorModel(net, SPEC, pipeline.mapper.mounts)
    shown: list[np.ndarray] = []
    infer = pipeline.mapper.infer
    pipeline.mapper.infer = lambda around: (shown.append(model.draw(around)), infer(around))[1]
    by_stamp = {}
    for update in pipeline.updates(Log(find_drive(drive, None).log).batches()):
        by_stamp[update.ego.stamp_ns] = shown[-1]
    for sample in found:
        np.testing.assert_array_equal(sample.image, by_stamp[sample.stamp_ns])


def test_a_disturbed_drive_shows_less_of_the_same_truth(drive: Path, found: list[Sample]) -> None:
    """Five seeds: none shows more, some show much less; each does the same twice, and truth and lidar stay."""
    plane = CHANNELS.index("count_15m")
    shares, stayed = [], 0
    for seed in range(5):
        cut = list(samples(drive, Disturbance(seed)))
        stays = [(one, other) for one in cut for other in found if one.stamp_ns == other.stamp_ns]
        stayed += len(stays)
        for one, other in stays:
            both = (one.truth != 0) & (other.truth != 0)
            np.testing.assert_array_equal(one.truth[both], other.truth[both])
            assert np.count_nonzero(one.truth) <= 1.02 * np.count_nonzero(other.truth)  # a silent radar earns nothing
            np.testing.assert_array_equal(one.lidar, other.lidar)
        shares.append(np.count_nonzero(cut[-1].image[plane]) / np.count_nonzero(found[-1].image[plane]))
    assert stayed >= 4 * len(found)  # where a radar is silent a cycle may end with another scan
    assert max(shares) <= 1.0
    assert min(shares) < 0.8
    one, other = (list(samples(drive, Disturbance(1))) for _ in range(2))
    assert [sample.image.tobytes() for sample in one] == [sample.image.tobytes() for sample in other]
