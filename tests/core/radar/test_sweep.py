"""The scans of a cycle together against each of them alone."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from echogrid.core.messages import RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import IDENTITY, SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise, deviation
from echogrid.core.radar.sweep import Sweep

NOISE = GateNoise()


def scans() -> list[PlacedScan]:
    """One of them without detections, one with an ambiguity."""
    rng, placed = np.random.default_rng(0), []
    for n, count in enumerate((7, 0, 12)):
        mount = Mount(SE2(3.0 - n, 0.8, 0.9 * n), 1.2, 20.0)
        values = rng.uniform(1, 40, count), rng.uniform(-1.2, 1.2, count), rng.normal(-5, 6, count), rng.normal(0, 9, count)
        placed.append(
            PlacedScan(
                RadarScan(f"r{n}", n, n, *values, ambiguity=6.0 * (n == 2)), mount, EgoState(n, SE2(1.0 * n, 2.0, 0.3), 6.0 - n, 0.4 * n)
            )
        )
    return placed


def test_a_sweep_has_of_each_scan_what_it_has_alone() -> None:
    placed = scans()
    sweep = Sweep.of(placed, NOISE)
    assert sweep.newest.stamp_ns == 2
    sensors = [one.ego.odom_from_base @ one.mount.base_from_sensor for one in placed]
    points, in_odom, origins, _ = sweep.placed_at(IDENTITY)
    np.testing.assert_array_equal(in_odom, points)
    np.testing.assert_array_equal(origins, np.array([sensors[n][:2] for n in sweep.scan]))
    for one, sensor, some in zip(placed, sensors, (slice(7), slice(7, 7), slice(7, None)), strict=True):
        scan, ego = one.scan, one.ego
        polar = np.stack((scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)), axis=1)
        np.testing.assert_array_equal(points[some], sensor.apply(polar))
        alone = deviation(scan.azimuth, scan.range_rate, scan.ambiguity, one.mount, ego.speed, ego.yaw_rate, NOISE)
        np.testing.assert_array_equal(sweep.sigmas[some], alone)
        np.testing.assert_array_equal(sweep.near[some], scan.range <= 20.0)
        assert (sweep.rcs[some] == scan.rcs).all()
        assert (sweep.stands(NOISE.sigmas)[some] == ((alone <= NOISE.sigmas) & (scan.range <= 20.0))).all()
    assert sweep.scan.tolist() == [0] * 7 + [2] * 12
    asked, standing = sweep.agreeing
    assert asked == [np.count_nonzero(one.scan.range <= 20.0) for one in placed]
    assert standing == [np.count_nonzero(sweep.stands(NOISE.sigmas)[sweep.scan == n]) for n in range(3)]


@given(st.builds(SE2, st.floats(-50, 50), st.floats(-50, 50), st.floats(-7, 7)))
def test_its_sensors_are_where_the_car_and_they_on_it_were(odom_from_base: SE2) -> None:
    placed = scans()
    sweep = Sweep.of(placed, NOISE)
    in_base, in_odom = sweep.sensors(odom_from_base)
    for one, base, odom in zip(placed, in_base.tolist(), in_odom, strict=True):
        sensor = odom_from_base.inverse() @ one.ego.odom_from_base @ one.mount.base_from_sensor
        assert base == [sensor.x, sensor.y, math.cos(sensor.yaw), math.sin(sensor.yaw)]
        np.testing.assert_array_equal(odom[:2], odom_from_base.apply(np.array([(sensor.x, sensor.y)]))[0])
        assert odom[2] == sensor.yaw + odom_from_base.yaw
        np.testing.assert_allclose(odom, one.ego.odom_from_base @ one.mount.base_from_sensor, atol=1e-9)


def test_of_some_of_its_scans() -> None:
    placed = scans()
    sweep = Sweep.of(placed, NOISE)
    assert sweep.only([True] * 3, NOISE) is sweep
    last = sweep.only([False, False, True], NOISE)
    assert last.placed == placed[2:]
    np.testing.assert_array_equal(last.sigmas, sweep.sigmas[7:])


def test_sigmas_are_of_the_range_rate_that_finite_differences_give() -> None:
    """A standing point off by 0.2 m/s, from a corner of a car that turns: straight to it, neither azimuth nor speed add to the sigma."""
    mount, ego = Mount(SE2(3.0, -1.0, -0.7), 1.2, 50.0), EgoState(0, SE2(0.0, 0.0, 0.0), 8.0, 0.5)
    azimuth, step = np.array([0.3, -0.9]), 1e-6
    place = mount.base_from_sensor.apply(10.0 * np.stack((np.cos(azimuth), np.sin(azimuth)), axis=1))
    later = SE2(8.0 * step, 0.0, 0.5 * step) @ mount.base_from_sensor
    rate = (np.hypot(*(place - (later.x, later.y)).T) - 10.0) / step
    exact = GateNoise(range_rate=0.1, azimuth=0.0, speed=0.0, yaw_rate=0.0)
    scan = RadarScan("r", 0, 0, np.full(2, 10.0), azimuth, rate + 0.2, np.zeros(2))
    np.testing.assert_allclose(Sweep.of([PlacedScan(scan, mount, ego)], exact).sigmas, 2.0, rtol=1e-4)
    turning = GateNoise(range_rate=0.0, azimuth=0.0, speed=0.0, yaw_rate=0.1)
    lever = math.hypot(3.0, 1.0)
    np.testing.assert_allclose(Sweep.of([PlacedScan(scan, mount, ego)], turning).sigmas, 2.0 / lever, rtol=1e-4)
