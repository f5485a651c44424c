"""A drive past posts through CAN frames: what is decoded lies where the posts are."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.support import posts
from tests.support.posts_drive import posts_drive
from tests.support.recordings import scan_of

from echogrid.config.loading import load_config
from echogrid.core.messages import RadarScan
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid_training.evaluation.recorded.drive import RealDrive, hear, placed

MOVER = (10.0, 0.1, 2.0, 5.0)  # range, azimuth, range rate, RCS: it moves away, whatever the car does


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return posts_drive(tmp_path_factory.mktemp("real") / "drive", beside=[MOVER])


@pytest.fixture(scope="module")
def drive(folder: Path) -> RealDrive:
    return hear(folder)


def test_reflections_lie_on_the_posts_and_movers_do_not_count(drive: RealDrive) -> None:
    found = drive.reflections(drive.scans)
    points = np.concatenate([scan.points for scan in found])
    made = {(sensor, stamp): len(seen) for sensor, stamp, seen in posts.scans()}
    assert len(points) == sum(made[scan.sensor, scan.stamp_ns] for scan, _ in drive.scans)
    distance, _ = cKDTree(posts.POSTS).query(points)
    assert distance.max() < 0.15  # m: the frames' steps of azimuth at 18 m, and the clock's microseconds
    for scan, (heard, ego) in zip(found, drive.scans, strict=True):
        sensor = posts.pose(heard.stamp_ns) @ posts.MOUNTS[heard.sensor]
        np.testing.assert_allclose(scan.origin, (sensor.x, sensor.y), atol=0.05)
        assert ego.stamp_ns == heard.stamp_ns


def test_scans_are_in_order_and_the_line_is_sampled(drive: RealDrive) -> None:
    stamps = [scan.stamp_ns for scan, _ in drive.scans]
    assert stamps == sorted(stamps)
    assert len(stamps) == len(list(posts.scans()))
    steps = np.diff([ego.odom_from_base.x for ego in drive.driven])
    np.testing.assert_allclose(steps, 0.1 * posts.SPEED, atol=0.06)


def test_nothing_left_out_is_the_service_s_own_map(drive: RealDrive, folder: Path) -> None:
    config = load_config(drive.config)
    pipeline = Pipeline(config, drive.config)
    for _ in pipeline.updates(Log(find_drive(folder, None).log).batches()):
        pass
    pipeline.mapper.end_cycle()
    expected, found = pipeline.mapper.map.whole(), drive.mapped(config).whole()
    assert found[:2] == expected[:2]
    np.testing.assert_array_equal(found[2], expected[2])


def test_what_is_left_out_is_not_in_the_map(drive: RealDrive) -> None:
    config = load_config(drive.config)
    right = {(scan.sensor, scan.stamp_ns) for scan, _ in drive.scans if scan.sensor.endswith("right")}
    row, _, log_odds = drive.mapped(config, right).whole()
    assert 0.2 < config.grid.cell * (row + np.argmax((log_odds > 0.85).any(axis=1))) < 5.1  # the posts on the left alone
    everything = {(scan.sensor, scan.stamp_ns) for scan, _ in drive.scans}
    assert drive.mapped(config, everything).whole()[2].size == 0


def test_scans_without_a_pose_are_passed_over(drive: RealDrive) -> None:
    motion = [item for _, item in drive.items if not isinstance(item, RadarScan)]
    early, inside, late = (scan_of("front_left", stamp, np.array([MOVER])) for stamp in (5, motion[40].stamp_ns + 7, 2 * 10**18))
    scans, driven = placed([early, late, *motion[:50], inside, *motion[50:]])
    assert [scan.stamp_ns for scan, _ in scans] == [inside.stamp_ns]
    assert math.isclose(driven[0].stamp_ns, motion[1].stamp_ns)
    assert placed([early]) == ([], [])
