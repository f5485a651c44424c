"""Dead reckoning against closed circles, a fine integration, and its own buffer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.messages import Speed, YawRate
from echogrid.core.motion.odometry import Odometry
from echogrid.core.motion.se2 import arc

MS = 1_000_000


def _drive(odometry: Odometry, seconds: float, speed: float, yaw_rate: float, start_ns: int = 0) -> int:
    """Samples every 10 ms, the yaw rate 5 ms after the speed; the stamp of the last one."""
    stamp_ns = start_ns
    for step in range(round(seconds * 100) + 1):
        stamp_ns = start_ns + step * 10 * MS
        odometry.add(Speed(stamp_ns, speed))
        odometry.add(YawRate(stamp_ns + 5 * MS, yaw_rate))
    return stamp_ns + 5 * MS


def test_a_full_circle_closes() -> None:
    odometry = Odometry()
    speed, yaw_rate = 5.0, 0.25
    first_ns = 5 * MS  # where both were known first
    _drive(odometry, 2 * math.pi / yaw_rate + 1, speed, yaw_rate)
    end = odometry.at(first_ns + round(2 * math.pi / yaw_rate * 1e9))
    assert end is not None
    assert math.hypot(end.odom_from_base.x, end.odom_from_base.y) < 1e-6
    assert end.odom_from_base.yaw == pytest.approx(2 * math.pi, abs=1e-6)


def test_half_a_circle_to_the_left_ends_at_plus_two_radii() -> None:
    odometry = Odometry()
    speed, yaw_rate = 5.0, 0.5
    _drive(odometry, math.pi / yaw_rate + 1, speed, yaw_rate)
    end = odometry.at(5 * MS + round(math.pi / yaw_rate * 1e9))
    assert end is not None
    assert end.odom_from_base.x == pytest.approx(0.0, abs=1e-6)
    assert end.odom_from_base.y == pytest.approx(20.0, abs=1e-6)


def test_changing_motion_equals_a_fine_integration() -> None:
    """Speed and yaw rate as smooth functions of time, sampled at 100 Hz, against Euler steps of 0.1 ms."""

    def speed(t: float) -> float:
        return 6 + 3 * math.sin(t)

    def yaw_rate(t: float) -> float:
        return 0.4 * math.cos(0.7 * t)

    odometry = Odometry(history=20)
    for step in range(1001):
        stamp_ns = step * 10 * MS
        odometry.add(Speed(stamp_ns, speed(step / 100)))
        odometry.add(YawRate(stamp_ns + 1, yaw_rate(step / 100)))
    t = (np.arange(100_000) + 0.5) * 1e-4
    yaw = np.cumsum(0.4 * np.cos(0.7 * t)) * 1e-4
    x, y = np.sum((6 + 3 * np.sin(t)) * np.cos(yaw)) * 1e-4, np.sum((6 + 3 * np.sin(t)) * np.sin(yaw)) * 1e-4
    end = odometry.states[-1].odom_from_base
    assert math.hypot(end.x - x, end.y - y) < 0.12  # of 60 m: the yaw rate lags by half a sample, the yaw by up to 2 mrad


def test_between_two_samples_the_pose_lies_on_their_arc() -> None:
    odometry = Odometry()
    _drive(odometry, 1.0, 8.0, 0.6)
    before, after = odometry.states[40], odometry.states[41]
    middle_ns = (before.stamp_ns + after.stamp_ns) // 2
    middle = odometry.at(middle_ns)
    assert middle is not None
    seconds = (middle_ns - before.stamp_ns) * 1e-9
    half = before.odom_from_base @ arc(before.speed * seconds, before.yaw_rate * seconds)
    assert math.hypot(middle.odom_from_base.x - half.x, middle.odom_from_base.y - half.y) < 1e-9
    there = odometry.at(after.stamp_ns)
    assert there is not None
    assert there.odom_from_base == after.odom_from_base


def test_there_is_no_pose_before_the_first_after_the_last_or_in_a_gap() -> None:
    odometry = Odometry(max_gap=0.5, max_extrapolation=0.1)
    assert odometry.at(0) is None
    last_ns = _drive(odometry, 1.0, 5.0, 0.0)
    assert odometry.at(4 * MS) is None
    assert odometry.at(last_ns + 90 * MS) is not None
    assert odometry.at(last_ns + 110 * MS) is None
    _drive(odometry, 0.1, 5.0, 0.0, start_ns=last_ns + 2000 * MS)
    assert odometry.gaps == 1
    assert odometry.at(last_ns + 1000 * MS) is None
    assert odometry.states[-1].odom_from_base.x == pytest.approx(5.0 * 1.1, abs=0.06)  # the gap was not driven


def test_standing_still_the_yaw_is_frozen() -> None:
    odometry = Odometry()
    _drive(odometry, 5.0, 0.0, 0.01)
    assert odometry.states[-1].odom_from_base.yaw == 0.0


def test_reverse_goes_back() -> None:
    odometry = Odometry()
    last_ns = _drive(odometry, 2.0, 3.0, 0.2)
    _drive(odometry, 2.0 + 0.01, -3.0, -0.2, start_ns=last_ns + 5 * MS)
    end = odometry.states[-1].odom_from_base
    assert math.hypot(end.x, end.y) < 0.1
    assert odometry.distance == pytest.approx(12.0, abs=0.1)


def test_old_samples_change_nothing_and_different_latencies_are_no_fault() -> None:
    odometry = Odometry()
    assert odometry.add(Speed(100 * MS, 1.0))
    assert odometry.add(YawRate(120 * MS, 0.0))
    assert not odometry.add(Speed(100 * MS, 9.0))
    assert not odometry.add(YawRate(90 * MS, 9.0))
    assert odometry.add(Speed(110 * MS, 2.0))  # older than the newest state, but the newest speed
    assert odometry.speed == Speed(110 * MS, 2.0)
    assert len(odometry.states) == 1


def test_the_buffer_is_bounded() -> None:
    odometry = Odometry(history=1.0)
    _drive(odometry, 60.0, 5.0, 0.1)
    assert len(odometry.states) <= 2 * 200 + 2
    newest_ns = odometry.states[-1].stamp_ns
    assert odometry.at(newest_ns - 999 * MS) is not None


def test_a_kind_that_falls_silent_is_held_for_a_moment_only() -> None:
    """A yaw rate without a speed must not drive on."""
    odometry = Odometry(max_hold=0.2)
    last_ns = _drive(odometry, 1.0, 5.0, 0.0)
    for step in range(1, 101):
        odometry.add(YawRate(last_ns + step * 10 * MS, 0.0))
    assert odometry.states[-1].odom_from_base.x == pytest.approx(5.0 * 1.2, abs=0.1)
    assert odometry.at(last_ns + 400 * MS) is None


def test_begun_anew_it_is_at_the_origin_and_keeps_the_bias() -> None:
    odometry = Odometry()
    _drive(odometry, 5.0, 0.0, 0.01)
    odometry.restart()
    assert odometry.at(0) is None
    assert not odometry.states
    _drive(odometry, 1.0, 5.0, 0.01)  # earlier than what was forgotten: the clock was set back
    end = odometry.states[-1].odom_from_base
    assert end.x == pytest.approx(5.0, abs=0.1)
    assert end.yaw == pytest.approx(0.0, abs=5e-5)  # the prior keeps back a five-hundredth


def test_a_creeping_car_turns_and_a_standing_one_does_not() -> None:
    """5 cm/s are way; what wheels tremble by is not."""
    for speed, turned in ((0.05, 0.3), (-0.05, 0.3), (0.015, 0.0), (-0.015, 0.0)):
        odometry = Odometry()
        _drive(odometry, 3.0, speed, 0.1)
        assert odometry.states[-1].odom_from_base.yaw == pytest.approx(turned, abs=0.01)


def test_between_two_samples_speed_and_yaw_rate_are_on_the_line_between_them() -> None:
    odometry = Odometry()
    for stamp_ns, speed, yaw_rate in ((0, 4.0, 0.1), (20 * MS, 6.0, 0.3)):
        odometry.add(YawRate(stamp_ns, yaw_rate))
        odometry.add(Speed(stamp_ns, speed))
    times = [state.stamp_ns for state in odometry.states]
    first, last = odometry.at(times[-2]), odometry.at(times[-1])
    quarter = odometry.at(times[-2] + (times[-1] - times[-2]) // 4)
    assert first is not None
    assert last is not None
    assert quarter is not None
    assert last.yaw_rate - first.yaw_rate > 0.1
    assert quarter.speed == pytest.approx(0.75 * first.speed + 0.25 * last.speed)
    assert quarter.yaw_rate == pytest.approx(0.75 * first.yaw_rate + 0.25 * last.yaw_rate)
