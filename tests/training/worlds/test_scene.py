"""The generated world: range rates against finite differences of ranges, rays against geometry by hand, paths against arcs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.messages import RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid_training.drives.demo import demo_path, demo_scene
from echogrid_training.driving.path import Leg, Path
from echogrid_training.recording import EPOCH_NS, RadarMount
from echogrid_training.worlds.scene import CORNERS, MAX_RANGE, NONE, Box, Mover, Scene, cast, drive, scan, wheel_speeds

H = 1e-4  # s
WALL = (((-50.0, 9.0), (80.0, 7.0)), ((30.0, -50.0), (33.0, 50.0)))
TURNING = Path((Leg(2.0, 8.0), Leg(2.0, 9.0, 0.4), Leg(2.0, 5.0, 0.4)), SE2(3.0, -2.0, 0.7))


def origin(path: Path, radar: RadarMount, time: float) -> SE2:
    return path.pose(time) @ radar.base_from_sensor


def hits(scene: Scene, path: Path, radar: RadarMount, time: float) -> tuple[RadarScan, np.ndarray]:
    """A scan without noise, and where its detections are in the world (N, 2)."""
    seen = scan(scene, path, radar, time, np.random.default_rng(2), NONE)
    along = np.stack((seen.range * np.cos(seen.azimuth), seen.range * np.sin(seen.azimuth)), axis=-1)
    return seen, origin(path, radar, time).apply(along)


def distance(path: Path, radar: RadarMount, time: float, points: np.ndarray) -> np.ndarray:
    pose = origin(path, radar, time)
    return np.hypot(*(points - (pose.x, pose.y)).T)


@pytest.mark.parametrize("radar", CORNERS, ids=lambda radar: radar.name)
@pytest.mark.parametrize("time", [1.0, 3.0, 5.0])
def test_range_rate_of_standing_things_is_the_derivative_of_their_range(radar: RadarMount, time: float) -> None:
    seen, points = hits(Scene(walls=WALL, cars=[Box(SE2(5.0, -6.0, 0.3))]), TURNING, radar, time)
    slope = (distance(TURNING, radar, time + H, points) - distance(TURNING, radar, time - H, points)) / (2 * H)
    assert len(seen) >= 5
    np.testing.assert_allclose(seen.range_rate, slope, atol=1e-4)


@pytest.mark.parametrize(
    "mover", [Mover(SE2(-20.0, 14.0, 0.2), 9.0), Mover(SE2(20.0, 10.0, 2.0), 4.0, 0.5), Mover(SE2(8.0, 4.0, 1.0), 0.0)]
)
def test_range_rate_of_moving_things_is_the_derivative_of_their_range(mover: Mover) -> None:
    time, found = 2.5, 0
    for radar in CORNERS:
        seen, points = hits(Scene(movers=[mover]), TURNING, radar, time)
        on_mover = mover.box(time).world_from_box.inverse().apply(points)
        before, after = (mover.box(time + step).world_from_box.apply(on_mover) for step in (-H, H))
        slope = (distance(TURNING, radar, time + H, after) - distance(TURNING, radar, time - H, before)) / (2 * H)
        np.testing.assert_allclose(seen.range_rate, slope, atol=1e-4)
        found += len(seen)
    assert found > 10


def test_detections_lie_on_the_surfaces_in_sight() -> None:
    """A wall 10 m to the left of a standing car that looks there, with a box before a part of it."""
    left = RadarMount("left", SE2(0.0, 0.0, math.pi / 2), math.radians(150.0))
    box = Box(SE2(0.0, 5.0, 0.0), length=4.0, width=2.0)
    standing = Path((Leg(1.0, 0.0),))
    seen, points = hits(Scene(walls=[((-60.0, 10.0), (60.0, 10.0))], cars=[box]), standing, left, 0.5)
    before_box = np.abs(np.tan(seen.azimuth)) < 2.0 / 4.0
    assert 0 < before_box.sum() < len(seen)
    np.testing.assert_allclose(points[before_box, 1], 4.0)
    assert (points[~before_box, 1] >= 4.0 - 1e-9).all()
    assert (seen.range <= MAX_RANGE).all()
    assert (np.abs(seen.azimuth) <= math.radians(75.0)).all()
    np.testing.assert_array_equal(seen.range_rate, 0.0)


def test_azimuth_is_positive_to_the_left() -> None:
    ahead = RadarMount("ahead", SE2(0.0, 0.0, 0.0), math.radians(150.0))
    seen, _ = hits(Scene(walls=[((1.0, 5.0), (10.0, 5.0))]), Path((Leg(1.0, 0.0),)), ahead, 0.5)
    assert len(seen) > 0
    assert (seen.azimuth > 0).all()


def test_rays_meet_the_nearest_segment_or_none() -> None:
    segments = np.array((((4.0, -1.0), (4.0, 1.0)), ((2.0, -1.0), (2.0, 1.0)), ((-3.0, 0.0), (-9.0, 0.0))))
    found, first = cast(segments, np.zeros(2), np.array((0.0, math.pi / 2, math.atan2(1.5, 4.0) + 0.2)))
    np.testing.assert_allclose(found, (2.0, np.inf, np.inf))
    assert first[0] == 1
    assert cast(np.zeros((0, 2, 2)), np.zeros(2), np.zeros(3))[0].tolist() == [np.inf] * 3


def test_a_path_of_constant_turn_closes_its_circle() -> None:
    circle = Path((Leg(1e-9, 6.0, 0.5), Leg(4 * math.pi, 6.0, 0.5)), speed=6.0)
    end = circle.pose(circle.duration)
    assert (end.x, end.y, end.yaw) == pytest.approx((0.0, 0.0, 2 * math.pi), abs=1e-2)


def test_a_path_is_the_integral_of_its_motion() -> None:
    """Position and heading against derivatives of themselves."""
    for time in np.linspace(0.1, TURNING.duration - 0.1, 20):
        one, other = TURNING.pose(time - 0.01), TURNING.pose(time + 0.01)
        speed, yaw_rate = TURNING.motion(np.array([time]))
        assert (other.yaw - one.yaw) / 0.02 == pytest.approx(yaw_rate[0], abs=1e-3)
        assert math.hypot(other.x - one.x, other.y - one.y) / 0.02 == pytest.approx(speed[0], rel=1e-3)
        assert math.atan2(other.y - one.y, other.x - one.x) == pytest.approx((one.yaw + other.yaw) / 2, abs=1e-4)


def test_wheels_of_a_left_turn() -> None:
    """Around a centre 10 m to the left of the rear axle, every wheel's speed is the turn rate times its distance to it."""
    (wheels,) = wheel_speeds(np.array([5.0]), np.array([0.5]))
    distances = [math.hypot(10.0 - side * 0.775, ahead) for ahead in (0.0, 2.7) for side in (1, -1)]
    np.testing.assert_allclose(wheels, 0.5 * np.array(distances))


def test_the_same_seed_makes_the_same_recording() -> None:
    def ranges(seed: int) -> list[float]:
        recording = drive(Scene(walls=WALL), Path((Leg(0.5, 5.0),)), seed)
        return [*np.concatenate([one.range for one in recording.scans]).tolist(), *recording.motion.yaw_rate.tolist()]

    assert ranges(1) == ranges(1) != ranges(2)


def test_the_demonstration_has_what_it_is_to_show() -> None:
    path, scene = demo_path(), demo_scene()
    assert path.duration == pytest.approx(40.0, abs=1.0)
    speed, _ = path.motion(np.arange(0.0, path.duration, 0.1))
    assert speed.max() <= 10.0
    assert path.pose(path.duration).yaw == pytest.approx(math.pi / 2)
    assert len(scene.movers) >= 2
    first = drive(scene, Path((Leg(1.0, 0.0),)), 0)
    counts = [len(one) for one in first.scans]
    assert 15 <= min(counts) <= max(counts) <= 35
    assert {one.sensor for one in first.scans} == {radar.name for radar in CORNERS}
    assert min(one.stamp_ns for one in first.scans) == EPOCH_NS
    assert first.truth.walls is not None


def test_nobody_drives_through_anything_in_the_demonstration() -> None:
    """Discs around the cars' middles and the outline of what stands keep apart."""
    path, scene = demo_path(), demo_scene()
    for time in np.arange(0.0, path.duration, 0.1):
        centre = path.pose(time) @ SE2(1.35, 0.0, 0.0)
        places = [(centre.x, centre.y), *((box.world_from_box.x, box.world_from_box.y) for box in (m.box(time) for m in scene.movers))]
        for index, place in enumerate(places):
            found, _ = cast(scene.standing, np.array(place), np.linspace(-math.pi, math.pi, 60))
            assert found.min() > 0.95 or abs(place[1]) > 170 or abs(place[0]) > 170
            assert all(math.dist(place, other) > 3.0 for other in places[:index])
