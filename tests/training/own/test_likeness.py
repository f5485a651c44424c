"""What drives show of a car is what it was: its mounts, its cycle, how many detections, and by how much its azimuths are off."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.support import posts
from tests.support.posts_drive import posts_drive

from echogrid_training.own.likeness import likenesses
from echogrid_training.sensors.episode import NEAR


def test_what_a_drive_past_posts_shows(street: Path) -> None:
    found = list(posts.scans())
    (car,) = likenesses([street], None)
    assert [(one.name, one.x, one.y) for one in car.radars] == [(name, mount.x, mount.y) for name, mount in posts.MOUNTS.items()]
    np.testing.assert_allclose([one.yaw for one in car.radars], [mount.yaw for mount in posts.MOUNTS.values()], atol=1e-5)
    np.testing.assert_allclose([one.fov for one in car.radars], 2 * posts.HALF_FOV)
    counts = [len(scan) for *_, scan in found]
    assert car.density == pytest.approx(np.mean([(scan[:, 0] < NEAR).sum() for *_, scan in found]))
    assert car.most == max(counts)
    assert car.reach == pytest.approx(max(scan[:, 0].max() for *_, scan in found if len(scan)), abs=0.02)
    stamps = [[stamp for sensor, stamp, _ in found if sensor == name] for name in posts.MOUNTS]
    gaps = [after - before for one in stamps for before, after in pairwise(one)]
    assert car.cycle == pytest.approx(np.median(gaps) * 1e-9, abs=1e-4)
    assert (car.rcs, car.ambiguity) == (5.0, 0.0)
    assert Counter(abs(one.azimuth_bias) < 1.5 * one.azimuth_sigma for one in car.radars) == {True: 4}


def test_radars_that_are_turned_show_azimuths_that_are_too_small(tmp_path: Path) -> None:
    off = math.radians(2.0)
    one, two = likenesses([posts_drive(tmp_path / "left", off), posts_drive(tmp_path / "right", -off)], None)
    for left, right in zip(one.radars, two.radars, strict=True):
        assert left.azimuth_bias < -1e-3 < 1e-3 < right.azimuth_bias  # rad: 15 m at one speed say little, and the sigma says so
        assert abs(left.azimuth_bias + off) < 2 * left.azimuth_sigma
        assert abs(right.azimuth_bias - off) < 2 * right.azimuth_sigma
