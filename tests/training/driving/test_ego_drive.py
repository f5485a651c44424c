import math

import numpy as np
import pytest

from echogrid.core.motion.se2 import IDENTITY, SE2
from echogrid_training.driving.ego_drive import drive
from echogrid_training.driving.pace import Manner, Run, clip, track
from echogrid_training.driving.steering import STEP, TIGHTEST, Course, follow
from echogrid_training.streets.network import Network, Street
from echogrid_training.streets.shapes import disc
from echogrid_training.streets.streets import plan_streets
from echogrid_training.streets.style import FAMILIES, draw
from echogrid_training.towns.town import Track

SECONDS = 40.0


@pytest.fixture(scope="module")
def drives() -> list[Track]:
    tracks = []
    for seed, family in enumerate(list(FAMILIES.values()) * 14):
        rng = np.random.default_rng(seed)
        style = draw(family, rng)
        way = drive(plan_streets(style, rng).network, SECONDS, rng)
        if way is not None:
            tracks.append(way.ego)
    assert len(tracks) > 38
    return tracks


def test_samples_are_every_10_ms_for_the_whole_drive(drives: list[Track]) -> None:
    for ego in drives:
        np.testing.assert_allclose(ego.time, np.arange(4001) / 100, atol=1e-9)


def test_speed_and_yaw_rate_are_the_derivatives_of_the_poses(drives: list[Track]) -> None:
    for ego in drives:
        middle_yaw = (ego.yaw[1:] + ego.yaw[:-1]) / 2
        x, y = np.diff(ego.x) * 100, np.diff(ego.y) * 100
        ahead = x * np.cos(middle_yaw) + y * np.sin(middle_yaw)
        aside = y * np.cos(middle_yaw) - x * np.sin(middle_yaw)
        np.testing.assert_allclose(ahead, (ego.speed[1:] + ego.speed[:-1]) / 2, atol=2e-3)
        np.testing.assert_allclose(aside, 0.0, atol=1e-6)  # base is the rear axle: it does not slip
        np.testing.assert_allclose(np.diff(ego.yaw) * 100, (ego.yaw_rate[1:] + ego.yaw_rate[:-1]) / 2, atol=1e-9)


def test_nobody_is_thrown_about(drives: list[Track]) -> None:
    for ego in drives:
        assert np.abs(np.diff(ego.speed) * 100).max() < 2.2
        assert np.abs(ego.speed * ego.yaw_rate).max() < 2.2
        assert np.abs(np.diff(ego.yaw_rate) * 100).max() < 2.5
        assert (np.abs(ego.yaw_rate) <= (TIGHTEST + 1e-9) * np.abs(ego.speed) + 1e-9).all()


def test_people_turn_stop_wait_and_reverse(drives: list[Track]) -> None:
    turned = [np.ptp(ego.yaw) > 1.0 for ego in drives]
    stood = [(np.abs(ego.speed) < 0.01).sum() > 100 for ego in drives]
    reversed_ = [(ego.speed < -0.3).sum() > 100 for ego in drives]
    assert np.mean(turned) > 0.6
    assert np.mean(stood) > 0.4
    assert 0.05 < np.mean(reversed_) < 0.6


def test_without_a_long_enough_road_there_is_no_drive() -> None:
    short = Network(np.array(((0.0, 0.0), (20.0, 0.0))), (Street((0, 1), np.array(((0.0, 0.0), (20.0, 0.0))), 6.0, 8.0),))
    assert drive(short, SECONDS, np.random.default_rng(0)) is None


def test_a_circle_is_followed_at_its_curvature_either_way() -> None:
    circle = disc(0.0, 0.0, 20.0, 200)[:150]
    forwards = follow(SE2(20.0, 0.0, math.pi / 2), circle)
    backwards = follow(SE2(20.0, 0.0, -math.pi / 2), circle, reverse=True)
    np.testing.assert_allclose(forwards.curvature[100:-100], 1 / 20.0, rtol=0.02)
    np.testing.assert_allclose(backwards.curvature, forwards.curvature, atol=1e-9)
    assert math.hypot(forwards.end.x, forwards.end.y) == pytest.approx(20.0, abs=0.2)


def test_a_course_of_a_quarter_circle_driven_as_a_track_ends_where_geometry_has_it() -> None:
    radius = 15.0
    count = round(radius * math.pi / 2 / STEP)
    course = Course(IDENTITY, False, np.full(count + 1, 1 / radius), np.zeros(count + 1), IDENTITY)
    driven = track([Run(course, np.full(count + 1, 6.0), halts=((8.0, 2.0),))], Manner())
    turn = count * STEP / radius
    assert driven.yaw[-1] == pytest.approx(turn, abs=1e-6)
    assert driven.x[-1] == pytest.approx(radius * math.sin(turn), abs=1e-4)
    assert driven.y[-1] == pytest.approx(radius * (1 - math.cos(turn)), abs=1e-4)
    standing = driven.speed[100:-100] == 0.0
    assert standing.sum() >= 195  # the halt


def test_a_clipped_track_starts_its_clock_anew_and_stands_at_its_end() -> None:
    course = follow(IDENTITY, np.array(((0.0, 0.0), (30.0, 0.0))))
    whole = track([Run(course, np.full(len(course.curvature), 5.0))], Manner())
    later = clip(whole, 2.0, 60.0)
    assert later.time[0] == 0.0
    assert later.x[0] == whole.x[200]
    assert later.x[-1] == whole.x[-1]
    assert later.speed[-1] == 0.0
