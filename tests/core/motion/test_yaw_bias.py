"""The yaw-rate bias is that of standing still, and of nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from echogrid.core.messages import Speed, YawRate
from echogrid.core.motion.odometry import Odometry
from echogrid.core.motion.yaw_bias import YawBias

STEP_NS = 10_000_000


def feed(bias: YawBias, start: float, rates: np.ndarray, *, standing: bool) -> float:
    for n, rate in enumerate(rates):
        bias.add(round(start * 1e9) + n * STEP_NS, float(rate), standing=standing)
    return start + len(rates) * 0.01


def test_the_mean_of_a_standstill() -> None:
    bias = YawBias()
    feed(bias, 0.0, np.random.default_rng(1).normal(0.007, 0.002, 1000), standing=True)
    assert bias.bias == pytest.approx(0.007, abs=3e-4)


def test_nothing_is_learnt_while_driving_or_in_a_short_stop() -> None:
    bias = YawBias()
    time = feed(bias, 0.0, np.full(500, 0.02), standing=False)
    time = feed(bias, time, np.full(190, 0.02), standing=True)
    feed(bias, time, np.full(100, 0.02), standing=False)
    assert bias.bias == 0.0


def test_creeping_under_the_wheels_cut_off_does_not_count() -> None:
    """The wheels read 0 already, or still, while the car turns: the first and the last 0.9 s of a stop of 4 s."""
    bias = YawBias()
    rates = np.concatenate((np.full(90, 0.04), np.full(220, 0.003), np.full(90, -0.04)))
    feed(bias, feed(bias, 0.0, rates, standing=True), np.full(10, 0.2), standing=False)
    assert bias.bias == pytest.approx(0.003, abs=1e-9)


def test_a_turntable_is_no_bias() -> None:
    bias = YawBias()
    feed(bias, 0.0, np.full(1000, 0.3), standing=True)
    assert bias.bias == 0.0


def test_after_a_stop_a_biased_sensor_drives_straight() -> None:
    odometry = Odometry()
    for n in range(4000):
        stamp_ns = n * STEP_NS
        odometry.add(Speed(stamp_ns, 0.0 if n < 1000 else 10.0))
        odometry.add(YawRate(stamp_ns + 1, 0.007))
    end = odometry.states[-1].odom_from_base
    assert end.x == pytest.approx(300.0, abs=0.2)
    assert abs(end.y) < 0.1  # without: 30 s at 0.007 rad/s are 12 degrees, and 31 m to the side
