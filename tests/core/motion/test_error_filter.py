"""What is learned of the motion sensors, against known errors, batch least squares and its own claims."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from tests.support.driven import MOUNTS, STEP, Driven, Errors, follow, town
from tests.support.places import DOCS

from echogrid.core.motion import error_model as model
from echogrid.core.motion.error_filter import SMOOTHED, WINDOW, ErrorFilter
from echogrid.core.motion.leg import Leg
from echogrid.core.motion.odometry import Odometry
from echogrid.core.motion.se2 import IDENTITY, SE2

DEGREE = math.radians(1.0)
KNOWN = Errors(0.02, 0.5 * DEGREE, 0.004, 1.48, 0.006, (1.2 * DEGREE, -0.8 * DEGREE, 0.5 * DEGREE, -1.5 * DEGREE), (0.04, -0.03, 0.0, 0.05))


def found(odometry: Odometry, place: int) -> tuple[float, float]:
    """Value and sigma."""
    errors = odometry.errors
    return float(errors.mean[place]), math.sqrt(errors.covariance[place, place])


def straight(seconds: float, speed: float) -> tuple[np.ndarray, np.ndarray]:
    count = round(seconds / STEP)
    return np.full(count, speed), np.zeros(count)


@pytest.mark.parametrize("moving", [0.0, 0.4])
def test_known_errors_are_recovered_within_the_claimed_sigma(moving: float) -> None:
    odometry = follow(Driven(*town(60.0), KNOWN, seed=1, moving=moving))
    radars = odometry.errors.places.values()
    true = {model.SCALE: KNOWN.scale, model.BIAS: KNOWN.bias, model.TRACK: KNOWN.track, model.UNEVEN: KNOWN.uneven}
    true |= {place + model.YAW: yaw for place, yaw in zip(radars, KNOWN.yaws, strict=True)}
    least = {model.SCALE: 0.006, model.BIAS: 0.12 * DEGREE, model.TRACK: 0.03, model.UNEVEN: 0.001}
    for place, value in true.items():
        estimate, sigma = found(odometry, place)
        assert abs(estimate - value) < 2.5 * sigma, place
        assert sigma < least.get(place, 0.8 * DEGREE), place


def test_what_is_surely_off_is_taken_off() -> None:
    drive = Driven(*town(120.0), KNOWN, seed=2)
    learning, raw = follow(drive), follow(drive, "never")
    ends = [odometry.states[-1].odom_from_base for odometry in (learning, raw)]
    off = [math.hypot(end.x - drive.way[-1, 0], end.y - drive.way[-1, 1]) for end in ends]
    assert learning.errors.bias == pytest.approx(KNOWN.bias, rel=0.25)
    assert off[0] < off[1] / 2


def test_straight_on_at_one_speed_nothing_is_known_and_motion_stays_raw() -> None:
    """A bias and uneven wheels look the same there, and so do a bias and four mounts' yaws."""
    drive = Driven(*straight(60.0, 12.0), Errors(bias=0.3 * DEGREE), seed=3)
    learning, raw = follow(drive), follow(drive, "never")
    assert found(learning, model.BIAS)[1] > 0.9 * 0.4 * DEGREE
    together = learning.errors.covariance[model.BIAS, model.UNEVEN]
    assert abs(together) > 0.98 * found(learning, model.BIAS)[1] * found(learning, model.UNEVEN)[1]
    assert learning.errors.bias == 0.0
    assert learning.states[-1].odom_from_base.yaw == raw.states[-1].odom_from_base.yaw


def test_a_mounts_yaw_is_no_better_known_than_the_bias_lets_it() -> None:
    """At one speed a bias turns what each radar sees like a yaw of bias x lever / speed."""
    learning = follow(Driven(*straight(60.0, 3.0), Errors(), seed=4, one_signal=True))
    bias = found(learning, model.BIAS)[1]
    assert bias == pytest.approx(0.4 * DEGREE, rel=0.05)
    for (name, mount), place in zip(MOUNTS.items(), learning.errors.places.values(), strict=True):
        assert found(learning, place + model.YAW)[1] > 0.9 * bias * abs(mount.base_from_sensor.x) / 3.0, name


@pytest.mark.parametrize("bias", [-0.41, 2.5])
def test_standing_still_finds_the_bias_also_one_far_beyond_the_prior(bias: float) -> None:
    count = round(10.0 / STEP)
    odometry = follow(Driven(np.zeros(count), np.zeros(count), Errors(bias=bias * DEGREE), seed=5))
    value, sigma = found(odometry, model.BIAS)
    assert sigma < 0.03 * DEGREE
    assert abs(value - bias * DEGREE) < 2 * sigma
    assert odometry.errors.bias == value


def test_wheels_that_are_one_signal_say_nothing_of_turning() -> None:
    odometry = follow(Driven(*town(60.0), Errors(bias=0.5 * DEGREE), seed=6, one_signal=True))
    assert found(odometry, model.BIAS)[0] == 0.0
    assert found(odometry, model.TRACK) == pytest.approx((model.USUAL_TRACK, 0.08))


def test_wheels_that_are_mixed_up_teach_nothing() -> None:
    drive = Driven(*town(60.0), Errors(bias=0.2 * DEGREE), seed=13)
    drive.difference = -drive.difference
    odometry = follow(drive)
    assert odometry.errors.bias == 0.0
    assert found(odometry, model.BIAS)[1] > 0.3 * DEGREE


def test_over_a_long_drive_the_covariance_stays_one() -> None:
    """Positive semi-definite up to rounding, and as unsure of the place as a quarter of an hour of drift makes it."""
    drive = Driven(*town(900.0), Errors(bias=0.1 * DEGREE), seed=14, detections=6)
    odometry = follow(drive)
    values = np.linalg.eigvalsh(odometry.errors.covariance)
    assert values[0] > -1e-12 * values[-1]
    assert 1.0 < math.sqrt(odometry.errors.certainty(5.0, 0.0).pose[0, 0]) < 7_000.0


def test_learning_only_while_standing_or_never_leaves_all_else_alone() -> None:
    stop = np.zeros(round(6.0 / STEP))
    speed, yaw_rate = town(20.0)
    drive = Driven(np.concatenate((stop, speed)), np.concatenate((stop, yaw_rate)), KNOWN, seed=7)
    standing, never = follow(drive, "standing"), follow(drive, "never")
    assert standing.errors.bias == pytest.approx(KNOWN.bias / (1 + KNOWN.turn_scale), rel=0.02)
    assert found(standing, model.SCALE)[0] == 0.0
    assert not never.errors.mean[[model.SCALE, model.BIAS]].any()


def test_the_poses_covariance_is_that_of_its_errors() -> None:
    """Twenty drives with errors as the priors have them: mean squared error in sigmas (NEES) of place and heading, within 99 % bands."""
    scores = []
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        yaws = tuple(rng.normal(0.0, 1.5 * DEGREE, 4).tolist())
        errors = Errors(
            *(rng.normal(0.0, sigma) for sigma in (0.01, 0.4 * DEGREE, 0.006)), rng.normal(1.55, 0.08), rng.normal(0.0, 0.01), yaws
        )
        drive = Driven(*town(16.0, seed), errors, seed=seed, detections=12)
        odometry = follow(drive)
        end = odometry.states[-1]
        off = drive.way[-1] - (end.odom_from_base.x, end.odom_from_base.y, end.odom_from_base.yaw)
        covariance = odometry.errors.certainty(end.speed, end.yaw_rate).pose
        scores.append((off[:2] @ np.linalg.solve(covariance[:2, :2], off[:2]), off[2] ** 2 / covariance[2, 2]))
    place, heading = np.mean(scores, axis=0)
    assert 1.03 < place < 3.34  # chi-squared with 40 degrees of freedom, halved: expected 2
    assert 0.36 < heading < 2.0  # with 20: expected 1


def test_it_agrees_with_batch_least_squares() -> None:
    """The errors of the rear axle and the gyro by Gauss-Newton over all windows of a drive at once, written down anew."""
    drive = Driven(*town(40.0), Errors(bias=0.4 * DEGREE, track=1.5, uneven=0.004), seed=8, detections=0)
    odometry = follow(drive)
    size = round(WINDOW / STEP)
    whole = len(drive.time) // size * size
    speed, gyro, difference = (one[:whole].reshape(-1, size).mean(axis=1) for one in (drive.wheels, drive.gyro, drive.difference))
    changes = np.gradient(gyro, WINDOW)
    sigma = np.hypot(0.004, 1.5 * 0.03 * changes)
    centre, prior = np.array((0.0, 0.0, 1.55, 0.0)), np.array((0.4 * DEGREE, 0.006, 0.08, 0.01))
    x = centre.copy()
    for _ in range(5):
        turned = gyro * (1 + x[1]) - x[0]
        slope = np.stack((np.full_like(gyro, -x[2]), x[2] * gyro, turned, speed), axis=1) / sigma[:, None]
        left = (difference - x[2] * turned - x[3] * speed) / sigma
        normal = slope.T @ slope + np.diag(prior**-2)
        x = x + np.linalg.solve(normal, slope.T @ left - (x - centre) / prior**2)
    sigmas = np.sqrt(np.diag(np.linalg.inv(normal)))
    for n, place in enumerate((model.BIAS, model.TURN_SCALE, model.TRACK, model.UNEVEN)):
        value, claimed = found(odometry, place)
        assert abs(value - x[n]) < 0.5 * sigmas[n]
        assert claimed == pytest.approx(sigmas[n], rel=0.25)


def test_a_new_map_begins_at_a_known_pose_and_keeps_what_was_learned() -> None:
    odometry = follow(Driven(*town(20.0), KNOWN, seed=9))
    before = odometry.errors.mean.copy()
    odometry.restart()
    assert not odometry.errors.certainty(0.0, 0.0).pose.any()
    assert (odometry.errors.mean[model.POSE :] == before[model.POSE :]).all()


def test_the_next_drive_of_the_car_begins_with_what_is_known_of_it() -> None:
    """Track and uneven wheels are known by then, so that another bias is found in seconds."""
    errors = KNOWN
    first = follow(Driven(*town(90.0), errors, seed=11))
    again = ErrorFilter(tuple(MOUNTS))
    again.recall(first.errors.keep())
    drive = Driven(*town(12.0, seed=1), replace(errors, bias=errors.bias + 0.1 * DEGREE), seed=12)
    cold, warm = follow(drive), follow(drive, errors=again)
    ends = [odometry.states[-1].odom_from_base for odometry in (cold, warm)]
    off = [math.hypot(end.x - drive.way[-1, 0], end.y - drive.way[-1, 1]) for end in ends]
    assert off[1] < off[0] / 2
    value, sigma = found(warm, model.BIAS)
    assert abs(value - errors.bias - 0.1 * DEGREE) < 2.5 * sigma
    assert sigma < found(cold, model.BIAS)[1]


def test_a_car_that_stood_for_weeks_or_was_started_ever_again_learns_as_a_new_one_does() -> None:
    """What nothing was learned of for long is unsure, but not as unsure as one likes: the next traffic would move it anywhere."""
    drive = Driven(*town(30.0, seed=2), replace(KNOWN, scale=0.0), seed=3, detections=6)
    _, new = model.prior(len(MOUNTS))
    stood, started = ErrorFilter(tuple(MOUNTS)), ErrorFilter(tuple(MOUNTS))
    for _ in range(1000):
        stood.travel(IDENTITY, IDENTITY, 3600.0, 0.0, 0.0, 0.0)
        started.recall(started.keep())
    for errors in (stood, started):
        assert (np.diag(errors.covariance)[model.POSE :] <= 9.01 * np.diag(new)[model.POSE :]).all()
        odometry = follow(drive, errors=errors)
        value, sigma = found(odometry, model.SCALE)
        assert abs(value) < 3 * sigma
        assert sigma < 0.01
        assert np.linalg.eigvalsh(odometry.errors.covariance)[0] > -1e-15


@pytest.mark.parametrize("rate", [0.06, -0.15])
def test_creeping_with_wheels_at_0_makes_the_heading_unsure_and_the_place(rate: float) -> None:
    """By all that it turned, and by 0.3 m in a second, which grow as a random walk's."""
    count = round(3.0 / STEP)
    drive = Driven(np.zeros(count), np.zeros(count), Errors(), seed=10)
    drive.gyro += rate
    pose = follow(drive).errors.certainty(0.0, 0.0).pose
    assert math.sqrt(pose[2, 2]) == pytest.approx(abs(rate) * 3.0, rel=0.1)
    assert np.sqrt(np.diag(pose)[:2]) == pytest.approx([0.3 * math.sqrt(3.0)] * 2, rel=0.05)


def test_a_gyro_that_shows_next_to_nothing_while_the_car_stands_is_no_creeping() -> None:
    errors = ErrorFilter((), "never")
    for _ in range(30):
        errors.travel(SE2(0.0, 0.0, 0.0), SE2(0.0, 0.0, 0.0), 0.1, 0.0, 0.019, 0.0)
    assert errors.certainty(0.0, 0.0).pose.max() < 1e-6


def test_an_outlier_of_the_wheels_changes_nothing() -> None:
    errors = ErrorFilter(())
    mean = errors.mean.copy()
    errors._observe({model.TRACK: 0.1}, 5.0, 1e-4)
    assert (errors.mean == mean).all()


UNITS = {"%": 0.01, "°/s": DEGREE, "°": DEGREE, "ms": 1e-3, "cm": 1e-2, "mm/s": 1e-3, "m": 1.0, "m/s": 1.0, "rad/s": 1.0}


def told(text: str) -> float:
    """The first number with a unit; 0 where there is none."""
    found = re.match(r"(?:[\d.]+ ± )?([\d.]+) ?(%|°/s|°|ms|cm|mm/s|m/s|m|rad/s)(?![\w/])", text)
    return float(found[1]) * UNITS[found[2]] if found else 0.0


def test_what_errors_may_be_is_as_the_document_says() -> None:
    """Of a car with two radars: priors, how far errors wander in a second and between drives, what is no error, and what disturbs."""
    text = (DOCS / "motion.md").read_text()
    table = text.split("| error | true value |")[1].split("\n\n")[0].splitlines()[2:]
    columns = [
        [told(cell) for cell in column] for column in zip(*([cell.strip() for cell in row.split("|")[3:6]] for row in table), strict=True)
    ]
    mean, covariance = model.prior(2)
    for column, found_ in zip(columns, (covariance, model.wandering(2), model.resting(2)), strict=True):
        expected = [0.0] * model.POSE + column[: model.CAR] + 2 * column[model.CAR :]
        np.testing.assert_allclose(found_, np.diag(np.square(expected)), rtol=1e-12)
    assert mean.tolist() == [0.0] * model.TRACK + [model.USUAL_TRACK] + [0.0] * (len(mean) - model.TRACK - 1)
    assert f"| {model.USUAL_TRACK:g} ± " in text
    for noise, pattern in {
        model.WHEEL_NOISE: r"what is left of them is (.*?) and",
        model.GYRO_NOISE: r"what is left of them is .*? and (.*?) in the",
        model.HEADING_NOISE: r"the heading wanders by (.*?) in √s",
        model.TURN_NOISE: r"in √s and (.*?) in √rad",
        model.ALONG_NOISE: r"the place by (.*?) in √m",
        model.SIDE_NOISE: r"the place by (.*?) in √m",
        model.STANDING_NOISE: r"of a stop \| bias \| (.*?) over a second",
        model.DIFFERENCE_NOISE: r"uneven wheels \| (.*?) \(recorded",
        model.DIFFERENCE_DELAY: r"and what (.*?) between the two signals",
    }.items():
        (said,) = re.findall(pattern, text)
        assert told(said) == pytest.approx(noise), pattern


def test_accelerations_are_of_the_last_fifth_of_a_second() -> None:
    errors, told = ErrorFilter(tuple(MOUNTS)), []
    for speed, yaw_rate in ((5.0, 0.1), (6.0, 0.3), (6.0, 0.3), (5.5, 0.2)):
        errors._accelerate(Leg(IDENTITY, SMOOTHED, SMOOTHED * speed, SMOOTHED * yaw_rate))
        told.append((errors.acceleration, errors.turn_acceleration))
    np.testing.assert_allclose(told, [(0.0, 0.0), (5.0, 1.0), (0.0, 0.0), (-2.5, -0.5)], atol=1e-9)
