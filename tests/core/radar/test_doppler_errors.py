"""Range rates of standing things against errors of wheels, gyro and mounts: derivatives, ambiguity, and what may not be learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs
from tests.support.driven import MOUNTS

from echogrid.core.messages import RadarScan
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.core.motion.error_model import BIAS, TRACK, TURN_SCALE, UNEVEN
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import IDENTITY
from echogrid.core.radar.doppler_errors import CORRELATED, DISTORTED, SLIPPING, DopplerErrors, equations, rows_of
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise, static_range_rate

NOISE = GateNoise()
EGO = EgoState(1_000_000_000, IDENTITY, 9.0, 0.3)


def placed(name: str, rate_off: float = 0.0, ambiguity: float = 0.0, stamp_ns: int = EGO.stamp_ns) -> PlacedScan:
    azimuth = np.linspace(-1.2, 1.2, 25)
    rate, _ = static_range_rate(azimuth, MOUNTS[name], EGO.speed, EGO.yaw_rate)
    scan = RadarScan(name, stamp_ns, stamp_ns, np.full(25, 9.0), azimuth, rate + rate_off, np.zeros(25), ambiguity)
    return PlacedScan(scan, MOUNTS[name], structs.replace(EGO, stamp_ns=stamp_ns))


def test_derivatives_equal_finite_differences() -> None:
    rng = np.random.default_rng(1)
    errors = ErrorFilter(tuple(MOUNTS))
    errors.acceleration, errors.turn_acceleration = 0.7, -0.2
    one = placed("front_right")
    rows = rows_of(errors, "front_right")
    errors.mean[rows] = rng.normal(0.0, 0.01, len(rows))
    slope, _, _ = equations(one, errors, NOISE)
    for n, row in enumerate(rows):
        ends = []
        for step in (-1e-5, 1e-5):
            errors.mean[row] += step
            ends.append(equations(one, errors, NOISE)[1])
            errors.mean[row] -= step
        np.testing.assert_allclose(slope[:, n], (ends[0] - ends[1]) / 2e-5, atol=1e-6)


def test_what_was_taken_off_wheels_and_gyro_is_put_back() -> None:
    """The same scan says the same, whatever of the errors the ego motion has already lost."""
    errors, one = ErrorFilter(tuple(MOUNTS)), placed("front_left")
    errors.mean[rows_of(errors, "front_left")] = 0.01
    before = equations(one, errors, NOISE)
    errors.scale, errors.bias = 0.02, -0.03
    corrected = PlacedScan(one.scan, one.mount, structs.replace(EGO, speed=EGO.speed * 1.02, yaw_rate=EGO.yaw_rate + 0.03))
    for mine, its in zip(equations(corrected, errors, NOISE), before, strict=True):
        np.testing.assert_allclose(mine, its, rtol=1e-9, atol=1e-9)


def test_without_errors_nothing_is_left_of_what_stands() -> None:
    _, left, weight = equations(placed("rear_left"), ErrorFilter(tuple(MOUNTS)), NOISE)
    np.testing.assert_allclose(left, 0.0, atol=1e-12)
    assert (weight > 0).all()


def test_range_rates_are_taken_modulo_their_ambiguity() -> None:
    _, left, _ = equations(placed("rear_left", rate_off=3 * 12.5 + 0.05, ambiguity=12.5), ErrorFilter(tuple(MOUNTS)), NOISE)
    np.testing.assert_allclose(left, 0.05, atol=1e-9)


def test_what_moves_has_no_weight() -> None:
    _, _, weight = equations(placed("rear_left", rate_off=4.0), ErrorFilter(tuple(MOUNTS)), NOISE)
    assert not weight.any()


def test_doppler_moves_no_error_of_gyro_and_rear_axle() -> None:
    errors = ErrorFilter(tuple(MOUNTS))
    before = errors.mean.copy()
    DopplerErrors().add([placed(name, rate_off=0.1) for name in MOUNTS], errors, NOISE)
    untouched = [BIAS, TURN_SCALE, TRACK, UNEVEN]
    assert (errors.mean[untouched] == before[untouched]).all()
    assert (errors.mean != before).any()
    np.testing.assert_allclose(np.diag(errors.covariance)[untouched], np.diag(ErrorFilter(tuple(MOUNTS)).covariance)[untouched])


@pytest.mark.parametrize(("later_ns", "used"), [(100_000_000, False), (200_000_000, True)])
def test_scans_that_only_repeat_what_was_said_are_left_out(later_ns: int, used: bool) -> None:
    errors, doppler = ErrorFilter(tuple(MOUNTS)), DopplerErrors()
    doppler.add([placed("rear_left")], errors, NOISE)
    before = errors.covariance.copy()
    doppler.add([placed("rear_left", stamp_ns=EGO.stamp_ns + later_ns)], errors, NOISE)
    assert (errors.covariance != before).any() == used


def test_what_stands_is_within_the_sigmas_of_noise_and_doubt_together() -> None:
    exact = replace(NOISE, range_rate=0.2, azimuth=0.0, sigmas=3.0)
    errors = ErrorFilter(tuple(MOUNTS))
    errors.covariance[:] = 0.0
    for off, stands in ((0.59, True), (-0.59, True), (0.61, False), (-0.61, False)):
        assert (equations(placed("rear_left", off), errors, exact)[2] > 0).all() == stands
    own = rows_of(errors, "rear_left")[-1]
    errors.covariance[own, own] = 0.15**2  # of the range rate itself, so that 0.25 m/s are a sigma
    for off, stands in ((0.74, True), (-0.76, False)):
        assert (equations(placed("rear_left", off), errors, exact)[2] > 0).all() == stands


@pytest.mark.parametrize(("count", "shared"), [(8, 1.0), (10, 1.0), (25, 2.5)])
def test_weights_are_inverse_variances_which_grow_abeam(count: int, shared: float) -> None:
    """Straight ahead at 9 m/s: an error of azimuth changes the range rate by 9 m/s times the bearing's sine."""
    errors, ego = ErrorFilter(tuple(MOUNTS)), structs.replace(EGO, yaw_rate=0.0)
    errors.acceleration = SLIPPING  # which doubles a variance
    azimuth = np.linspace(-1.2, 1.2, count)
    rate, _ = static_range_rate(azimuth, MOUNTS["rear_left"], ego.speed, 0.0)
    scan = RadarScan("rear_left", ego.stamp_ns, ego.stamp_ns, np.full(count, 9.0), azimuth, rate, np.zeros(count), 0.0)
    weight = equations(PlacedScan(scan, MOUNTS["rear_left"], ego), errors, NOISE)[2]
    abeam = 9.0 * np.sin(azimuth + MOUNTS["rear_left"].base_from_sensor.yaw)
    variance = NOISE.range_rate**2 + (abeam * NOISE.azimuth) ** 2 + (abeam * DISTORTED) ** 2
    np.testing.assert_allclose(1.0 / weight, 2.0 * CORRELATED * shared * variance, rtol=1e-9)
