"""The yaw-rate bias is that of standing still, and of nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from echogrid.core.messages import Speed, YawRate
from echogrid.core.motion.odometry import Odometry
from echogrid.core.motion.standstill import Standstill

STEP_NS = 10_000_000


def feed(standstill: Standstill, start: float, rates: np.ndarray, *, standing: bool) -> list[tuple[float, float]]:
    """What is confirmed: seconds and means."""
    given = (standstill.add(round(start * 1e9) + n * STEP_NS, float(rate), standing=standing) for n, rate in enumerate(rates))
    return [one for one in given if one is not None]


def mean(confirmed: list[tuple[float, float]]) -> float:
    seconds, rates = np.array(confirmed).T
    return float(np.average(rates, weights=seconds))


def test_the_mean_of_a_standstill() -> None:
    confirmed = feed(Standstill(), 0.0, np.random.default_rng(1).normal(0.007, 0.002, 1000), standing=True)
    assert mean(confirmed) == pytest.approx(0.007, abs=3e-4)
    assert 7.0 < sum(seconds for seconds, _ in confirmed) <= 8.0  # of 10 s, without the first second and the last


def test_nothing_is_learnt_while_driving_or_in_a_short_stop() -> None:
    standstill = Standstill()
    assert not feed(standstill, 0.0, np.full(500, 0.02), standing=False)
    assert not feed(standstill, 5.0, np.full(190, 0.02), standing=True)
    assert not feed(standstill, 6.9, np.full(100, 0.02), standing=False)


def test_creeping_under_the_wheels_cut_off_does_not_count() -> None:
    """The wheels read 0 already, or still, while the car turns: the first and the last 0.9 s of a stop of 4.8 s."""
    standstill = Standstill()
    rates = np.concatenate((np.full(90, 0.04), np.full(300, 0.003), np.full(90, -0.04)))
    assert mean(feed(standstill, 0.0, rates, standing=True)) == pytest.approx(0.003, abs=1e-9)
    assert not feed(standstill, 4.8, np.full(10, 0.2), standing=False)


def test_a_turntable_is_no_bias() -> None:
    assert not feed(Standstill(), 0.0, np.full(1000, 0.3), standing=True)


def test_after_a_stop_a_biased_sensor_drives_straight() -> None:
    odometry = Odometry()
    for n in range(4000):
        stamp_ns = n * STEP_NS
        odometry.add(Speed(stamp_ns, 0.0 if n < 1000 else 10.0))
        odometry.add(YawRate(stamp_ns + 1, 0.007))
    end = odometry.states[-1].odom_from_base
    assert end.x == pytest.approx(300.0, abs=0.2)
    assert abs(end.y) < 0.1  # without: 30 s at 0.007 rad/s are 12 degrees, and 31 m to the side


def test_each_reading_counts_once_in_its_batch() -> None:
    """Of a rate that rises by 0.01 rad/s in a second the means say which readings they are of: 1.00 to 1.50 s, then 1.51 to 2.01 s."""
    confirmed = feed(Standstill(), 0.0, 1e-4 * np.arange(302), standing=True)
    np.testing.assert_allclose(confirmed, ((0.5, 0.0125), (0.5, 0.0176)), rtol=1e-9)
