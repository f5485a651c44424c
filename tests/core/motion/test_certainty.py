"""How sure the filter is of pose and motion, against ways that part, and against draws of the errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.messages import Floats
from echogrid.core.motion import error_model as model
from echogrid.core.motion.error_filter import STEP, ErrorFilter
from echogrid.core.motion.se2 import SE2, arc

CAR = model.POSE + model.CAR  # errors of a car without radars


def array(pose: SE2) -> Floats:
    return np.array((pose.x, pose.y, pose.yaw))


def after_a_leg(mean: Floats, covariance: Floats, speed: float, yaw_rate: float) -> tuple[ErrorFilter, Floats]:
    """The filter after a leg on which wheels and gyro showed this, a share and a bias taken off; and by how much the true way, whose
    errors are `mean`, ends elsewhere."""
    errors = ErrorFilter(())
    errors.mean[:], errors.covariance[:], errors.scale, errors.bias = mean, covariance, 0.01, 0.004
    before = SE2(3.0, -2.0, 0.7)
    after = before @ arc(speed * 1.01 * STEP, (yaw_rate - 0.004) * STEP)
    errors.travel(before, after, STEP, speed, yaw_rate, 0.0)
    truly = speed * (1 + mean[model.SCALE]), yaw_rate * (1 + mean[model.TURN_SCALE]) - mean[model.BIAS]
    true = SE2(*(array(before) + mean[: model.POSE])) @ arc(truly[0] * STEP, truly[1] * STEP)
    return errors, array(true) - array(after)


def some_mean(rng: np.random.Generator, sigma: float) -> Floats:
    """Near what is taken off, so that squares of what is left do not count."""
    mean = rng.normal(0.0, sigma, CAR)
    mean[model.SCALE] += 0.01
    mean[model.BIAS] += 0.004
    return mean


@pytest.mark.parametrize("speed", [0.4, 9.0, -3.0])
def test_the_error_of_a_pose_is_where_the_true_way_ends(speed: float) -> None:
    rng = np.random.default_rng(0)
    for yaw_rate in (-0.4, 0.0, 0.3):
        errors, off = after_a_leg(some_mean(rng, 1e-3), np.zeros((CAR, CAR)), speed, yaw_rate)
        np.testing.assert_allclose(errors.mean[: model.POSE], off, atol=2e-6 * (1 + abs(speed)))


@pytest.mark.parametrize("speed", [0.4, 9.0])
def test_the_covariance_goes_the_way_of_the_errors_and_grows_by_what_is_no_error(speed: float) -> None:
    """Along and across the way, which goes about 40 degrees to the left, and of the heading; the errors themselves wander."""
    rng, yaw_rate = np.random.default_rng(1), 0.3
    root = rng.normal(0.0, 1e-3, (CAR, CAR))
    mean, small = some_mean(rng, 1e-4), 1e-5
    step = np.eye(CAR)
    base = after_a_leg(mean, np.zeros((CAR, CAR)), speed, yaw_rate)[1]
    for place in range(CAR):
        other = mean.copy()
        other[place] += small
        step[: model.POSE, place] = (after_a_leg(other, np.zeros((CAR, CAR)), speed, yaw_rate)[1] - base) / small
    errors, _ = after_a_leg(mean, root @ root.T, speed, yaw_rate)
    length, middle = speed * 1.01 * STEP, 0.7 + (yaw_rate - 0.004) * STEP / 2
    turn = np.array(((math.cos(middle), -math.sin(middle)), (math.sin(middle), math.cos(middle))))
    expected = step @ (root @ root.T) @ step.T + model.wandering(0) * STEP
    expected[:2, :2] += turn @ np.diag((model.ALONG_NOISE**2, model.SIDE_NOISE**2)) @ turn.T * length
    expected[2, 2] += model.HEADING_NOISE**2 * STEP + model.TURN_NOISE**2 * yaw_rate * STEP
    sigmas = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(errors.covariance / np.outer(sigmas, sigmas), expected / np.outer(sigmas, sigmas), atol=0.003)
    still, _ = after_a_leg(mean, np.zeros((CAR, CAR)), speed, yaw_rate)
    np.testing.assert_allclose(still.covariance, expected - step @ (root @ root.T) @ step.T, atol=1e-12, rtol=2e-3)


def test_what_is_said_of_the_motion_is_what_draws_of_the_errors_make_of_it() -> None:
    rng, speed, yaw_rate = np.random.default_rng(2), 7.0, -0.8
    root = rng.normal(0.0, 0.02, (CAR, CAR))
    errors = ErrorFilter(())
    errors.mean[:], errors.covariance[:], errors.scale, errors.bias = rng.normal(0.0, 0.02, CAR), root @ root.T, 0.01, -0.02
    drawn = errors.mean + rng.normal(size=(100_000, CAR)) @ root.T
    wheels = speed * (drawn[:, model.SCALE] - errors.scale) + rng.normal(0.0, model.WHEEL_NOISE, len(drawn))
    gyro = yaw_rate * drawn[:, model.TURN_SCALE] - (drawn[:, model.BIAS] - errors.bias) + rng.normal(0.0, model.GYRO_NOISE, len(drawn))
    found, off = errors.certainty(speed, yaw_rate), np.stack((wheels, gyro))
    scale = np.sqrt(np.outer(np.diag(found.motion), np.diag(found.motion)))
    np.testing.assert_allclose(found.motion / scale, off @ off.T / len(drawn) / scale, atol=0.02)
    pose = drawn[:, : model.POSE].T
    np.testing.assert_allclose(found.pose, pose @ pose.T / len(drawn), atol=0.02 * np.diag(found.pose).max())


def test_wheels_that_are_mixed_up_are_known_by_the_first_turn() -> None:
    errors = ErrorFilter(())
    assert errors._go_together(0.0, 0.0)
    assert not errors._go_together(0.3, -0.3 * model.USUAL_TRACK)
