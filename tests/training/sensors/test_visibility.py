"""Rays and points against one segment at a time, and what moves where its track says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.support.tiny_towns import car_mover, track

from echogrid_training.sensors.visibility import Near, Traffic, crossings, in_sight, losses, nearest_points, poses_at
from echogrid_training.towns.town import Track


def crossing(segment: np.ndarray, origin: np.ndarray, bearing: float) -> float:
    """The distance to one segment along one ray, by solving for it; inf without."""
    ray = np.array((math.cos(bearing), math.sin(bearing)))
    matrix = np.stack((ray, segment[0] - segment[1]), axis=1)
    if abs(np.linalg.det(matrix)) < 1e-12:
        return math.inf
    distance, share = np.linalg.solve(matrix, segment[0] - origin)
    return float(distance) if distance > 0 and 0 <= share <= 1 else math.inf


@pytest.mark.parametrize("seed", range(5))
def test_rays_meet_what_the_slow_reference_meets(seed: int) -> None:
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-20.0, 20.0, (60, 2))
    segments = np.stack((starts, starts + rng.normal(0.0, 6.0, (60, 2))), axis=1)
    origin, bearings = rng.uniform(-5.0, 5.0, 2), rng.uniform(-7.0, 7.0, 50)
    slow = np.array([[crossing(segment, origin, bearing) for segment in segments] for bearing in bearings])
    found = crossings(segments, origin, bearings)
    assert len(found.ray) == np.isfinite(slow).sum()
    np.testing.assert_allclose(found.distance, slow[found.ray, found.segment])


@pytest.mark.parametrize("seed", range(5))
def test_losses_add_up_over_all_that_is_before_a_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-20.0, 20.0, (40, 2))
    segments = np.stack((starts, starts + rng.normal(0.0, 6.0, (40, 2))), axis=1)
    loss, points, origin = rng.uniform(0.5, 9.0, 40), rng.uniform(-20.0, 20.0, (30, 2)), np.array((1.0, 2.0))
    for point, found, seen in zip(points, losses(segments, loss, origin, points), in_sight(segments, origin, points), strict=True):
        distance, bearing = math.dist(point, origin), math.atan2(point[1] - origin[1], point[0] - origin[0])
        before = np.array([crossing(segment, origin, bearing) for segment in segments]) < distance - 0.05
        assert found == pytest.approx(loss[before].sum())
        assert seen == (not before.any())


def test_no_ray_slips_through_a_corner() -> None:
    """A closed polygon around the origin, with a ray through every corner."""
    angles = np.linspace(0.0, 2 * np.pi, 90, endpoint=False)
    corners = np.stack((np.cos(angles), np.sin(angles)), axis=-1) * np.linspace(5.0, 9.0, 90)[:, None]
    segments = np.stack((corners, np.roll(corners, -1, axis=0)), axis=1)
    found, nearest = crossings(segments, np.zeros(2), np.arctan2(corners[:, 1], corners[:, 0])), np.full(90, np.inf)
    np.minimum.at(nearest, found.ray, found.distance)
    np.testing.assert_allclose(nearest, np.linspace(5.0, 9.0, 90))


def test_without_segments_or_rays_there_is_nothing() -> None:
    assert len(crossings(np.zeros((0, 2, 2)), np.zeros(2), np.zeros(3)).ray) == 0
    assert len(crossings(np.ones((4, 2, 2)), np.zeros(2), np.zeros(0)).ray) == 0


def test_near_leaves_out_nothing_within_reach() -> None:
    rng = np.random.default_rng(1)
    starts = rng.uniform(-200.0, 200.0, (500, 2))
    segments = np.stack((starts, starts + rng.normal(0.0, 20.0, (500, 2))), axis=1)
    near = Near(segments, 30.0)
    for origin in rng.uniform(-100.0, 100.0, (50, 2)):
        away = np.hypot(*(nearest_points(segments, origin) - origin).T)
        found = near(origin)
        assert set(np.flatnonzero(away < 30.0)) <= set(found.tolist())
        assert away[found].max() < 30.0 + 2 * 16.0


def test_poses_between_samples_lie_on_the_arc() -> None:
    """A circle known at ten points only."""
    fine = track(10.0, speed=5.0, yaw_rate=0.3, x=3.0, yaw=1.0)
    coarse = Track(*(getattr(fine, name)[::100] for name in ("time", "x", "y", "yaw", "speed", "yaw_rate")))
    found = poses_at(coarse, fine.time)
    for name in ("x", "y", "yaw", "speed", "yaw_rate"):
        np.testing.assert_allclose(getattr(found, name), getattr(fine, name), atol=1e-9)


def test_traffic_is_where_its_tracks_are_while_they_last() -> None:
    movers = (car_mover(track(2.0, speed=4.0, x=1.0)), car_mover(track(1.0, y=50.0, yaw=np.pi / 2)))
    traffic = Traffic(movers, np.array((0.5, 1.5)))
    assert traffic.at(0).mover.tolist() == [0, 1]
    late = traffic.at(1)
    assert late.mover.tolist() == [0]
    segments = late.segments()
    assert segments.shape == (4, 2, 2)
    np.testing.assert_allclose(segments.reshape(-1, 2).mean(axis=0), (7.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(np.abs(segments.reshape(-1, 2) - (7.0, 0.0)), [(2.25, 0.9)] * 8)
    corners = segments[:, 0]
    assert np.cross(np.append(corners[1] - corners[0], 0), np.append(corners[2] - corners[1], 0))[2] > 0  # counter-clockwise
    assert Traffic((), np.array((0.0,))).at(0).segments().shape == (0, 2, 2)
