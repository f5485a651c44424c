"""How radars alone see the car move, on detections whose range rates come from finite differences of ranges."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from echogrid.core.messages import RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import IDENTITY, SE2, arc
from echogrid.core.radar.doppler_motion import LEAST, DopplerMotion, doppler_motion
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep
from echogrid.core.trust.mount_check import other_mount

MOUNTS = [
    Mount(SE2(x, y, math.radians(yaw)), math.radians(75), 25.0)
    for x, y, yaw in ((3.6, 0.8, 45.0), (3.6, -0.8, -45.0), (-0.8, 0.8, 135.0), (-0.8, -0.8, -135.0))
]


def scan(mount: Mount, speed: float, yaw_rate: float, rng: np.random.Generator, count: int = 25, ambiguity: float = 0.0) -> RadarScan:
    """Standing points somewhere in the field of view."""
    range_, azimuth = rng.uniform(2, 20, count), rng.uniform(-1.2, 1.2, count)
    points = mount.base_from_sensor.apply(np.stack((range_ * np.cos(azimuth), range_ * np.sin(azimuth)), axis=1))
    step = 1e-5

    def distance(time: float) -> np.ndarray:
        sensor = arc(speed * time, yaw_rate * time) @ mount.base_from_sensor
        return np.hypot(points[:, 0] - sensor.x, points[:, 1] - sensor.y)

    rate = (distance(step) - distance(-step)) / (2 * step) + rng.normal(0, 0.1, count)
    if ambiguity:
        rate = (rate + ambiguity / 2) % ambiguity - ambiguity / 2
    return RadarScan("r", 0, 0, range_, azimuth, rate, np.zeros(count), ambiguity)


def seen_by(scans: list[RadarScan]) -> DopplerMotion | None:
    """Of the first mounts, by a car of which nothing is known."""
    ego = EgoState(0, IDENTITY, 0.0, 0.0)
    return doppler_motion(Sweep.of([PlacedScan(one, mount, ego) for one, mount in zip(scans, MOUNTS, strict=False)], GateNoise()))


def test_support_is_the_share_that_agrees_beyond_the_two_that_any_motion_explains() -> None:
    rng = np.random.default_rng(5)
    scans = [scan(mount, 8.0, 0.1, rng) for mount in MOUNTS]
    for one in scans:
        one.range_rate[:5] += 30.0
    seen = seen_by(scans)
    assert seen is not None
    assert seen.support == (80 - 2) / (100 - 2)


@pytest.mark.parametrize(("speed", "yaw_rate"), [(0.0, 0.0), (8.0, 0.0), (-3.0, 0.2), (5.0, -0.5), (25.0, 0.05)])
def test_speed_and_yaw_rate_are_seen_among_a_third_of_movers(speed: float, yaw_rate: float) -> None:
    rng = np.random.default_rng(3)
    scans = [scan(mount, speed, yaw_rate, rng) for mount in MOUNTS]
    for one in scans:
        one.range_rate[:8] = rng.uniform(-15, 15, 8)
    seen = seen_by(scans)
    assert seen is not None
    assert seen.speed == pytest.approx(speed, abs=0.12)
    assert seen.yaw_rate == pytest.approx(yaw_rate, abs=0.04)
    assert 0.6 < seen.support < 0.8


def test_modulo_an_ambiguity_as_well() -> None:
    rng = np.random.default_rng(4)
    seen = seen_by([scan(mount, 7.0, 0.1, rng, ambiguity=16.0) for mount in MOUNTS])
    assert seen is not None
    assert (seen.speed, seen.yaw_rate) == (pytest.approx(7.0, abs=0.12), pytest.approx(0.1, abs=0.04))


def test_too_few_say_nothing() -> None:
    rng = np.random.default_rng(5)
    assert seen_by([scan(MOUNTS[0], 5.0, 0.0, rng, 0)]) is None
    assert seen_by([scan(MOUNTS[0], 5.0, 0.0, rng, LEAST - 1)]) is None
    assert seen_by([scan(MOUNTS[0], 5.0, 0.0, rng, LEAST)]) is not None


def test_what_is_beyond_the_mounts_range_does_not_count() -> None:
    rng = np.random.default_rng(9)
    scans = [scan(mount, 5.0, 0.1, rng) for mount in MOUNTS]
    seen = seen_by(scans)
    for one in scans:
        one.range[12:], one.range_rate[12:] = 30.0, 3.0
    near = [structs.replace(one, **{key: getattr(one, key)[:12] for key in ("range", "azimuth", "range_rate", "rcs")}) for one in scans]
    assert seen_by(scans) == seen_by(near) != seen


@pytest.mark.parametrize("really", [1, 3])
def test_a_swapped_radar_shows_how_it_is_mounted(really: int) -> None:
    """What a radar at another corner measured, taken for that of the front left."""
    measured = scan(MOUNTS[really], 6.0, 0.0, np.random.default_rng(6), 40)
    other = other_mount(measured, MOUNTS[0], EgoState(0, IDENTITY, 6.0, 0.0), GateNoise())
    assert other.share > 0.9
    assert abs(math.remainder(math.radians(other.yaw_deg) - MOUNTS[really].base_from_sensor.yaw, math.tau)) < math.radians(10)


@pytest.mark.parametrize("yaw_rate", [0.0, 0.8])
def test_reversed_azimuths_are_named_and_the_yaw_that_looks_the_same(yaw_rate: float) -> None:
    """One scan does not tell them apart, in a bend either: the yaw is on the other side of the way of the radar itself."""
    measured = scan(MOUNTS[0], 6.0, yaw_rate, np.random.default_rng(6), 40)
    measured.azimuth[:] *= -1
    other = other_mount(measured, MOUNTS[0], EgoState(0, IDENTITY, 6.0, yaw_rate), GateNoise())
    assert min(other.share, other.reversed_share) > 0.9
    place = MOUNTS[0].base_from_sensor
    way = math.atan2(yaw_rate * place.x, 6.0 - yaw_rate * place.y)
    assert abs(math.remainder(math.radians(other.yaw_deg) - (2 * way - place.yaw), math.tau)) < math.radians(10)


def test_a_turned_radar_is_not_called_mirrored() -> None:
    configured = MOUNTS[0].base_from_sensor
    turned = replace(MOUNTS[0], base_from_sensor=SE2(configured.x, configured.y, configured.yaw + math.radians(60.0)))
    measured = scan(turned, 6.0, 0.8, np.random.default_rng(8), 40)
    other = other_mount(measured, MOUNTS[0], EgoState(0, IDENTITY, 6.0, 0.8), GateNoise())
    assert other.reversed_share < 0.5 < 0.9 < other.share
    assert abs(math.remainder(math.radians(other.yaw_deg) - turned.base_from_sensor.yaw, math.tau)) < math.radians(10)


def test_what_moves_fits_no_mount() -> None:
    """A column of cars that come the other way, and nothing else in view."""
    rng = np.random.default_rng(7)
    traffic = scan(MOUNTS[0], 20.0, 0.0, rng, 40)
    other = other_mount(traffic, MOUNTS[0], EgoState(0, IDENTITY, 8.0, 0.0), GateNoise())
    assert max(other.share, other.reversed_share) < 0.4
