"""A drive between posts, half of its scans left out: the map is asked before it can know, and ends as the service's own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support import posts

from echogrid.config.loading import load_config
from echogrid_training.evaluation.recorded.drive import FARTHEST, RealDrive, hear
from echogrid_training.own.half import Answers, halve
from echogrid_training.own.measure import every_other


@pytest.fixture(scope="module")
def drive(street: Path) -> RealDrive:
    return hear(street)


def test_the_finished_map_is_the_services(drive: RealDrive) -> None:
    config, left_out = load_config(drive.config, "analytic"), every_other(drive)
    found, expected = halve(drive, config, left_out).map.whole(), drive.mapped(config, left_out).whole()
    assert found[:2] == expected[:2]
    np.testing.assert_array_equal(found[2], expected[2])


def test_a_map_that_is_shown_nothing_says_nothing(drive: RealDrive) -> None:
    everything = {(scan.sensor, scan.stamp_ns) for scan, _ in drive.scans}
    asked = Answers.joined(halve(drive, load_config(drive.config, "analytic"), everything).answers)
    assert len(asked) > 100
    assert not asked.log_odds.any()
    assert np.isneginf(asked.reach).all()
    assert np.isinf(asked.age).all()


def test_posts_are_found_before_the_scan_is_seen(drive: RealDrive) -> None:
    """All of them stand, so what a ray hits was hit before once it has been in view; between posts and radar there is nothing."""
    half = halve(drive, load_config(drive.config, "analytic"), every_other(drive))
    asked = Answers.joined(half.answers)
    late = asked.where((asked.stretch >= 0) & (asked.age < 2))
    assert (late.reach[late.hit] > 0).mean() > 0.9
    assert (late.log_odds[~late.hit] <= 0).mean() > 0.9
    assert asked.range[asked.hit].max() < FARTHEST
    assert half.maps == 1
    assert half.way == pytest.approx(posts.SPEED * posts.SECONDS, abs=1.0)


def test_nothing_is_asked_twice_from_one_place(drive: RealDrive) -> None:
    half = halve(drive, load_config(drive.config, "analytic"), every_other(drive))
    for radar in range(4):
        places = np.array([look.ego.odom_from_base.x for look in half.looks if look.radar == radar])
        assert (np.diff(places) >= 0.5).all()
    assert sum(len(one) for one in half.left_out) > sum(len(look.found.range) for look in half.looks)
