"""One turn in a round room with a floor, beside what geometry says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.config.tables import Body
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid_training.labelling.ground import flat
from echogrid_training.labelling.lidar_mount import LidarMount, base_from_lidar, load_mount
from echogrid_training.labelling.lidar_turn import Reduced, reduce
from echogrid_training.sensors.lidar import AZIMUTHS, bearings

MOUNT = LidarMount(x=1.2, y=0.1, z=1.8, yaw_deg=90.0, pitch_deg=2.0, roll_deg=-1.0)
POSE = SE2(10.0, -4.0, 0.7)
NOTHING = np.empty((0, 2))


def in_lidar(base: np.ndarray) -> np.ndarray:
    pose = base_from_lidar(MOUNT)
    return (base - pose.place) @ pose.rotation


def reduced(points: np.ndarray, pose: SE2, moving: np.ndarray = NOTHING) -> Reduced:
    """Of points (N, 3) in the lidar's frame, on level ground."""
    base = base_from_lidar(MOUNT)
    there = base.apply(points)
    return reduce(there, flat(there, base.place), base.place[:2], pose, Body(), moving)


def room(radius: float, height: float, every: float = 0.1) -> np.ndarray:
    """(N, 3) in base: a wall around the lidar."""
    angle = np.radians(np.arange(0, 360, every))
    return np.stack((1.2 + radius * np.cos(angle), 0.1 + radius * np.sin(angle), np.full(len(angle), height)), axis=-1)


def test_attitude_is_yaw_after_pitch_after_roll() -> None:
    """A vector ahead of the lidar, step by step."""
    pose = base_from_lidar(LidarMount(x=0.0, y=0.0, z=1.0, yaw_deg=90.0, pitch_deg=10.0))
    np.testing.assert_allclose(
        pose.apply(np.array([[1.0, 0.0, 0.0]]))[0], (0.0, math.cos(math.radians(10)), 1 - math.sin(math.radians(10))), atol=1e-12
    )
    left = base_from_lidar(LidarMount(x=0.0, y=0.0, z=1.0, roll_deg=90.0)).apply(np.array([[0.0, 1.0, 0.0]]))[0]
    np.testing.assert_allclose(left, (0.0, 0.0, 2.0), atol=1e-12)


def test_the_nearest_that_stands_and_neither_ground_nor_the_car() -> None:
    points = np.concatenate((room(9.0, 1.0), room(12.0, 1.5), room(6.0, 0.1), room(4.0, 2.5), room(0.5, 1.0)))
    found = reduced(in_lidar(points), POSE)
    np.testing.assert_allclose(found.ranges, 9.0, atol=0.02)
    assert not found.excluded.any()
    np.testing.assert_allclose(found.origin, POSE.apply(np.array([[1.2, 0.1]]))[0])


def test_where_only_ground_came_back_it_is_free_as_far_as_that() -> None:
    found = reduced(in_lidar(room(8.0, 0.0)), POSE)
    np.testing.assert_allclose(found.ranges, 8.0, atol=0.02)
    assert found.excluded.all()
    far = reduced(in_lidar(room(41.0, 0.0)), POSE)
    assert np.isinf(far.ranges).all()


def test_where_nothing_came_back_nothing_is_known() -> None:
    points = room(8.0, 1.0)
    half = points[points[:, 0] > 1.2]
    found = reduced(in_lidar(half), SE2(0.0, 0.0, 0.0))
    behind = np.cos(bearings()) < -0.02
    assert (found.ranges[behind] == 0).all()
    assert found.excluded[behind].all()
    coarse = reduced(in_lidar(room(8.0, 1.0, every=0.6)), SE2(0.0, 0.0, 0.0))
    np.testing.assert_allclose(coarse.ranges, 8.0, atol=0.02)  # between two columns it is free as between them
    assert 0.3 < coarse.excluded.mean() < 0.6


def test_what_moves_leaves_nothing() -> None:
    ahead = POSE.apply(np.array([[10.2, 0.1]]))
    found = reduced(in_lidar(room(9.0, 1.0)), POSE, ahead)
    bearing = (bearings() - POSE.yaw + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_array_equal(found.excluded, 18.0 * np.abs(np.sin(bearing / 2)) < 2.5)
    assert len(found.ranges) == AZIMUTHS


def test_a_mount_that_is_not_one_is_said(tmp_path: object) -> None:
    path = tmp_path / "lidar.toml"  # type: ignore[operator]
    for text, expected in (("x = 1\ny = 0", "the key 'z' is missing"), ("x = 1\ny = 0\nz = 2\nyaw = 3", "unknown key 'yaw'")):
        path.write_text(text)
        with pytest.raises(EchogridError, match=expected):
            load_mount(path)
