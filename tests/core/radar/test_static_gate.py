"""The gate against finite differences of range, and what it lets through."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echogrid.core.motion.se2 import SE2, arc
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise, deviation, fold, static_range_rate

mounts = st.builds(lambda x, y, yaw: Mount(SE2(x, y, yaw), math.pi, 50.0), st.floats(-1, 4), st.floats(-1, 1), st.floats(-math.pi, math.pi))


@given(mounts, st.floats(-15, 15), st.floats(-1, 1), st.floats(1, 30), st.floats(-1.5, 1.5))
def test_range_rate_is_the_finite_difference_of_range(mount: Mount, speed: float, yaw_rate: float, distance: float, azimuth: float) -> None:
    """A standing point, seen from a sensor on a car that drives an arc: lever arm and yaw rate included."""
    point = mount.base_from_sensor.apply(np.array([[distance * math.cos(azimuth), distance * math.sin(azimuth)]]))
    step = 1e-4
    ranges = []
    for time in (-step, step):
        sensor = arc(speed * time, yaw_rate * time) @ mount.base_from_sensor
        ranges.append(math.hypot(*(point[0] - (sensor.x, sensor.y))))
    predicted, _ = static_range_rate(np.array([azimuth]), mount, speed, yaw_rate)
    assert predicted[0] == pytest.approx((ranges[1] - ranges[0]) / (2 * step), abs=1e-5)


@given(mounts, st.floats(-15, 15), st.floats(-1, 1), st.floats(-1.5, 1.5))
def test_the_derivative_by_azimuth(mount: Mount, speed: float, yaw_rate: float, azimuth: float) -> None:
    step = 1e-5
    low, high = (static_range_rate(np.array([azimuth + d]), mount, speed, yaw_rate)[0][0] for d in (-step, step))
    _, derivative = static_range_rate(np.array([azimuth]), mount, speed, yaw_rate)
    assert derivative[0] == pytest.approx((high - low) / (2 * step), abs=1e-5)


def test_driving_towards_a_wall_it_comes_nearer() -> None:
    """The sign, by hand: range rate is d(range)/dt, so ahead at 10 m/s it is -10."""
    front = Mount(SE2(3.7, 0.0, 0.0), 1.3, 50.0)
    assert static_range_rate(np.array([0.0]), front, 10.0, 0.0)[0][0] == -10.0


@given(st.floats(-100, 100), st.floats(0.5, 30))
def test_folding_takes_off_whole_intervals(residual: float, ambiguity: float) -> None:
    folded = fold(np.array([residual]), ambiguity)[0]
    assert abs(folded) <= ambiguity / 2 * (1 + 1e-9)
    turns = (residual - folded) / ambiguity
    assert turns == pytest.approx(round(turns), abs=1e-6)


def test_a_static_target_abeam_stays_and_a_mover_goes() -> None:
    """At 45 degrees and 10 m/s a gate on the x component alone would call a static target moving (see docs of other trackers)."""
    corner = Mount(SE2(3.7, 0.8, math.radians(45)), 1.3, 50.0)
    azimuth = np.radians([-60.0, -45.0, 0.0, 45.0, 60.0])
    static, _ = static_range_rate(azimuth, corner, 10.0, 0.2)
    noise = GateNoise()
    assert (deviation(azimuth, static, 0.0, corner, 10.0, 0.2, noise) < 1e-6).all()
    assert (deviation(azimuth, static + 3.0, 0.0, corner, 10.0, 0.2, noise) > noise.sigmas).all()
    aliased = (static + 10.31) % 20.62 - 10.31  # as a sensor with an interval of 20.62 m/s reports it
    assert (deviation(azimuth, aliased, 20.62, corner, 10.0, 0.2, noise) < 1e-6).all()


def test_the_threshold_grows_abeam() -> None:
    """An azimuth error does nothing to a point ahead and most to one abeam."""
    front = Mount(SE2(3.7, 0.0, 0.0), 3.2, 50.0)
    azimuth = np.array([0.0, math.pi / 2])
    static, _ = static_range_rate(azimuth, front, 14.0, 0.0)
    ahead, abeam = deviation(azimuth, static + 0.9, 0.0, front, 14.0, 0.0, GateNoise())
    assert ahead > GateNoise().sigmas > abeam


def test_each_error_counts_by_what_it_does_to_the_prediction() -> None:
    """One at a time, a sigma of it put into the prediction is a sigma; of the yaw rate where it does most."""
    corner = Mount(SE2(3.7, 0.8, math.radians(45)), 3.2, 50.0)
    azimuth = np.linspace(-math.pi, math.pi, 721)
    speed, yaw_rate, little = 10.0, 0.2, 1e-5
    none = GateNoise(range_rate=0.0, azimuth=0.0, speed=0.0, yaw_rate=0.0)

    def off(noise: GateNoise, seen: np.ndarray, turning: float = yaw_rate) -> np.ndarray:
        return deviation(azimuth, seen, 0.0, corner, speed, turning, noise)

    straight, _ = static_range_rate(azimuth, corner, speed * (1 + little), 0.0)
    shown = np.abs(np.cos(azimuth + math.radians(45))) > 0.01  # abeam a speed does nothing
    np.testing.assert_allclose(off(replace(none, speed=little), straight, 0.0)[shown], 1.0, rtol=1e-4)
    turned, _ = static_range_rate(azimuth, corner, speed, yaw_rate + little)
    assert off(replace(none, yaw_rate=little), turned).max() == pytest.approx(1.0, rel=1e-4)
    aside, derivative = static_range_rate(azimuth + little, corner, speed, yaw_rate)
    shown = np.abs(derivative) > 0.1
    np.testing.assert_allclose(off(replace(none, azimuth=little), aside)[shown], 1.0, rtol=1e-3)
    static, _ = static_range_rate(azimuth, corner, speed, yaw_rate)
    np.testing.assert_allclose(off(replace(none, range_rate=0.1), static - 0.1), 1.0, rtol=1e-9)
    every = GateNoise(range_rate=0.1, azimuth=0.02, speed=0.03, yaw_rate=0.04)
    parts = [replace(none, **{name: getattr(every, name)}) for name in ("range_rate", "azimuth", "speed", "yaw_rate")]
    np.testing.assert_allclose(off(every, static + 1.0) ** -2, sum(off(part, static + 1.0) ** -2 for part in parts), rtol=1e-9)
