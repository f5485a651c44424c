"""What the motion sensors report against the motion they have."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.support.tiny_towns import track

from echogrid_training.recording import Motion
from echogrid_training.sensors.episode import MotionErrors
from echogrid_training.sensors.motion_model import sense_motion
from echogrid_training.towns.town import Track

PERFECT = MotionErrors(wheel_sigma=0.0, wheel_step=0.0, yaw_sigma=0.0, yaw_step=0.0)


def sensed(errors: MotionErrors, path: Track) -> Motion:
    return sense_motion(path, errors, np.random.default_rng(0))


def with_errors(**changes: object) -> MotionErrors:
    return replace(PERFECT, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(("speed", "yaw_rate"), [(5.0, 0.5), (5.0, -0.5), (-3.0, 0.3), (-3.0, 0.0)])
def test_perfect_wheels_move_as_the_points_they_stand_on(speed: float, yaw_rate: float) -> None:
    """Each wheel's speed is that of its place on the car, with the sign of the way it rolls."""
    motion = sensed(PERFECT, track(1.0, speed, yaw_rate))
    for place, found in zip(((0.0, 0.775), (0.0, -0.775), (2.7, 0.775), (2.7, -0.775)), motion.wheel_speed[50], strict=True):
        true = math.hypot(speed - yaw_rate * place[1], yaw_rate * place[0])
        assert found == pytest.approx(math.copysign(true, speed))
    np.testing.assert_allclose(motion.wheel_speed[:, :2].mean(axis=1), speed)
    np.testing.assert_allclose(motion.yaw_rate, yaw_rate)
    assert len(motion.wheel_stamp_ns) == 100
    assert (np.diff(motion.wheel_stamp_ns) == 10_000_000).all()


def test_scale_bias_and_slip() -> None:
    fast = sensed(with_errors(wheel_scale=1.01, yaw_scale=0.99, yaw_bias=0.002), track(1.0, 10.0, 0.2))
    np.testing.assert_allclose(fast.wheel_speed[:, :2].mean(axis=1), 10.1)
    np.testing.assert_allclose(fast.yaw_rate, 0.99 * 0.2 + 0.002)
    time = np.arange(101) / 100
    starting = Track(time, time**2, 0 * time, 0 * time, 2.0 * time, 0 * time)
    slipping = sensed(with_errors(slip=0.005), starting).wheel_speed[50]
    np.testing.assert_allclose(slipping, 1.0 * (1 + 0.005 * 2.0))


def test_wheels_are_silent_below_their_cut_off_and_at_standstill() -> None:
    noisy = with_errors(wheel_sigma=0.05, standstill=0.6)
    assert (sensed(noisy, track(1.0, 0.5)).wheel_speed == 0).all()
    assert (sensed(noisy, track(1.0, 0.7)).wheel_speed > 0).all()
    assert (sensed(with_errors(wheel_sigma=0.05), track(1.0)).wheel_speed == 0).all()


def test_steps_and_noise_have_their_size() -> None:
    motion = sensed(with_errors(wheel_sigma=0.02, wheel_step=0.03, yaw_sigma=0.002, yaw_step=0.0005), track(20.0, 8.0, 0.1))
    np.testing.assert_allclose(motion.wheel_speed / 0.03, np.round(motion.wheel_speed / 0.03), atol=1e-9)
    np.testing.assert_allclose(motion.yaw_rate / 0.0005, np.round(motion.yaw_rate / 0.0005), atol=1e-9)
    assert motion.yaw_rate.std() == pytest.approx(0.002, rel=0.1)
    assert motion.wheel_speed[:, 0].std() == pytest.approx(math.hypot(0.02, 0.03 / math.sqrt(12)), rel=0.1)


def test_latency_shows_the_past() -> None:
    time = np.arange(201) / 100
    turning = Track(time, 0 * time, 0 * time, 0.5 * time**2 / 2, 0 * time, 0.5 * time)
    motion = sensed(with_errors(yaw_latency=0.02), turning)
    np.testing.assert_allclose(motion.yaw_rate[10:], 0.5 * (np.arange(10, 200) / 100 - 0.02))
