"""Mistakes that look alike: told apart by what the two do not share; where nothing tells them apart, neither is said."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from msgspec import structs

from echogrid.core.messages import RadarScan, Speed, YawRate
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise
from echogrid.judging.finding import Finding
from echogrid.judging.judge import Judgement, judge
from echogrid.judging.offsets import LIMIT, time_offsets
from echogrid.judging.on_the_way import bias_on_the_way
from echogrid.judging.recorded import RadarTrack, collect
from echogrid.judging.refining import Errors, Estimate, RadarErrors

MOUNTS = {
    name: Mount(SE2(x, y, math.radians(yaw)), math.radians(75), 25.0)
    for name, x, y, yaw in (
        ("front_left", 3.6, 0.8, 45.0),
        ("front_right", 3.6, -0.8, -45.0),
        ("rear_left", -0.8, 0.8, 135.0),
        ("rear_right", -0.8, -0.8, -135.0),
    )
}
Motion, Scans = list[Speed | YawRate], list[RadarScan]
STEP = 0.01  # s


@cache
def past_posts(bend: float, seconds: float = 20.0) -> tuple[tuple[Speed | YawRate, ...], tuple[RadarScan, ...]]:
    """A car between two rows of posts, 5 to 9 m/s, that turns by up to `bend` rad/s: range rates are finite differences of ranges."""
    random = np.random.default_rng(8)
    time = np.arange(0.0, seconds, STEP)
    speed, rate = 7.0 + 2.0 * np.sin(0.9 * time), bend * np.sin(0.7 * time)
    yaw = np.cumsum(rate) * STEP
    place = np.cumsum(speed * np.exp(1j * yaw)) * STEP
    along = random.integers(0, len(time), 260)
    posts = place[along] + 1j * np.exp(1j * yaw[along]) * random.uniform(3.0, 13.0, 260) * random.choice((-1, 1), 260)
    motion: Motion = []
    scans: Scans = []
    for n in range(1, len(time) - 1):
        stamp = round(time[n] * 1e9)
        motion += [Speed(stamp, float(speed[n]), difference=float(1.55 * rate[n])), YawRate(stamp, float(rate[n]))]
        if n % 8:
            continue
        for name, mount in MOUNTS.items():
            sits = mount.base_from_sensor
            at = [place[k] + np.exp(1j * yaw[k]) * complex(sits.x, sits.y) for k in (n - 1, n, n + 1)]
            seen = (posts - at[1]) * np.exp(-1j * (yaw[n] + sits.yaw))
            near = np.flatnonzero((np.abs(seen) < 25.0) & (np.abs(np.angle(seen)) < mount.half_fov))
            range_rate = (np.abs(posts - at[2]) - np.abs(posts - at[0]))[near] / (2 * STEP) + random.normal(0.0, 0.08, len(near))
            range_ = np.abs(seen)[near] + random.normal(0.0, 0.05, len(near))
            azimuth = np.angle(seen)[near] + random.normal(0.0, 0.01, len(near))
            scans.append(RadarScan(name, stamp, stamp, range_, azimuth, range_rate, np.full(len(near), np.nan)))
    return tuple(motion), tuple(scans)


def judged(motion: Sequence[Speed | YawRate], scans: Sequence[RadarScan], mounts: dict[str, Mount] | None = None) -> Judgement:
    mounts = MOUNTS if mounts is None else mounts
    return judge(collect(motion, scans, mounts), dict.fromkeys(mounts, "one"))


def said(judgement: Judgement) -> list[tuple[str, tuple[str, ...]]]:
    return [(one.code, one.radars) for one in judgement.findings]


def speeds(motion: Sequence[Speed | YawRate], factor: float) -> Motion:
    return [structs.replace(one, speed=one.speed * factor) if isinstance(one, Speed) else one for one in motion]


def rates(motion: Sequence[Speed | YawRate], change: Callable[[float], float]) -> Motion:
    return [structs.replace(one, yaw_rate=change(one.yaw_rate)) if isinstance(one, YawRate) else one for one in motion]


@pytest.mark.parametrize("bend", [0.0, 0.3])
def test_nothing_is_said_of_the_drive_as_it_is(bend: float) -> None:
    assert said(judged(*past_posts(bend))) == []


@pytest.mark.parametrize("factor", [1 / 3.6, 3.6])
def test_the_unit_of_the_speed_is_not_that_of_the_range_rates(factor: float) -> None:
    """Straight on both explain Doppler alike; ranges change as range rates say, or do not."""
    motion, scans = past_posts(0.0)
    assert said(judged(speeds(motion, factor), scans)) == [("speed_unit", ())]
    scaled = [structs.replace(one, range_rate=one.range_rate * factor) for one in scans]
    found = said(judged(motion, scaled))
    assert sorted(found) == sorted(("range_rate_unit", (name,)) for name in MOUNTS)


def test_a_scale_near_to_none_is_said_once() -> None:
    """11 % of all range rates, give or take the noise of each radar: no radar is called scaled by itself."""
    motion, scans = past_posts(0.3)
    scaled = [structs.replace(one, range_rate=one.range_rate * (1.13 if one.sensor == "rear_left" else 1.11)) for one in scans]
    assert [code for code, _ in said(judged(motion, scaled)) if code.startswith("range_rate")] == []


@pytest.mark.parametrize("factor", [1.5, 0.7])
def test_the_scale_of_the_yaw_rate(factor: float) -> None:
    motion, scans = past_posts(0.3)
    judgement = judged(rates(motion, lambda rate: rate * factor), scans)
    assert said(judgement) == [("yaw_rate_scale", ())]
    assert judgement.findings[0].value == pytest.approx(1 / factor, abs=0.12)


def test_nor_is_it_blamed_for_one_radar_that_sits_elsewhere() -> None:
    motion, scans = past_posts(0.3)
    place = MOUNTS["front_left"].base_from_sensor
    moved = {**MOUNTS, "front_left": replace(MOUNTS["front_left"], base_from_sensor=place._replace(x=place.x - 1.5))}
    assert said(judged(motion, scans, moved)) == [("mount_x", ("front_left",))]


def test_a_gentle_bend_the_wrong_way_round_moves_no_mounts() -> None:
    """2 °/s: too little to weigh signs, and enough to put every radar somewhere else."""
    motion, scans = past_posts(0.05)
    codes = {code for code, _ in said(judged(rates(motion, lambda rate: -rate), scans))}
    assert codes <= {"yaw_rate_sign"}


def mirrored(one: RadarScan) -> RadarScan:
    """From the radar on the other side of the car, with azimuths of the other sign: as a car that is its own mirror image has it."""
    side = one.sensor.split("_")
    return structs.replace(one, sensor=f"{side[0]}_{'right' if side[1] == 'left' else 'left'}", azimuth=-one.azimuth)


def test_a_mirrored_car_is_told_from_a_turned_yaw_rate_by_the_wheels() -> None:
    """Doppler cannot tell them apart; the outer wheel is the faster one in either bend."""
    motion, scans = past_posts(0.3)
    assert {code for code, _ in said(judged(motion, [mirrored(one) for one in scans]))} == {"left_right_swapped", "azimuth_sign"}
    assert said(judged(rates(motion, lambda rate: -rate), scans)) == [("yaw_rate_sign", ())]


def test_wheels_with_each_others_signal() -> None:
    motion, scans = past_posts(0.3)
    swapped = [structs.replace(one, difference=-one.difference) if isinstance(one, Speed) else one for one in motion]
    assert said(judged(swapped, scans)) == [("wheels_swapped", ())]
    single = [structs.replace(one, difference=0.0) if isinstance(one, Speed) else one for one in motion]
    assert said(judged(single, scans)) == []


def test_a_bias_without_a_stop() -> None:
    """By what is seen again: with it, and without."""
    motion, scans = past_posts(0.05)
    for off in (math.radians(0.6), 0.0):
        bias = bias_on_the_way(rates(motion, off.__add__), scans, MOUNTS, GateNoise())
        assert math.degrees(bias.value - off) == pytest.approx(0.0, abs=0.15)
        assert math.degrees(bias.sigma) < 0.2


def test_traffic_is_not_called_garbled_and_garbled_is_not_called_traffic() -> None:
    """Few detections, six of eight on vehicles ahead that keep their distance; and as few that fit another motion in each scan."""
    motion, _ = past_posts(0.0)
    mount = {"front": Mount(SE2(3.7, 0.0, 0.0), math.radians(20), 60.0)}
    random, speed = np.random.default_rng(4), [one for one in motion if isinstance(one, Speed)]

    def heard(traffic: bool) -> Scans:
        scans = []
        for one in speed[::5]:
            azimuth = random.uniform(-0.3, 0.3, 8)
            stands = -one.speed * np.cos(azimuth) + random.normal(0.0, 0.08, 8)
            anyhow = random.normal(0.0, 8.0) * np.cos(azimuth) + random.normal(0.0, 8.0) * np.sin(azimuth)
            own = np.where(np.arange(8) < 6, 1.0 + random.normal(0.0, 0.1, 8), stands) if traffic else anyhow
            scans.append(RadarScan("front", one.stamp_ns, one.stamp_ns, random.uniform(8, 60, 8), azimuth, own, np.full(8, np.nan)))
        return scans

    among = judged(motion, heard(traffic=True), mount)
    assert said(among) == []
    assert [one.code for one in among.undecided if "front" in one.sentence] == ["needs_speed"]
    assert said(judged(motion, heard(traffic=False), mount)) == [("unexplained", ("front",))]


def test_ranges_in_the_car_are_in_another_unit() -> None:
    """Whatever they do from scan to scan: half of them nearer than the bumper."""
    motion, scans = past_posts(0.0)
    random = np.random.default_rng(1)
    near = [structs.replace(one, range=random.uniform(0.02, 0.25, len(one.range))) if one.sensor == "rear_left" else one for one in scans]
    assert said(judged(motion, near)) == [("range_unit", ("rear_left",))]


def offsets(values_ms: Sequence[float], sigma_ms: float = 6.0) -> list[Finding]:
    """What is said of radars with these offsets, unrelated, each with that sigma."""
    unknown = Estimate(0.0, 1.0)
    radars = [RadarErrors(unknown, Estimate(one / 1e3, sigma_ms / 1e3), unknown, unknown, unknown, 0.1) for one in values_ms]
    errors = Errors(tuple(radars), unknown, unknown, unknown, None, np.eye(len(values_ms)) * (sigma_ms / 1e3) ** 2)
    nothing = np.zeros(0)
    tracks = [RadarTrack(str(n), MOUNTS["front_left"], *[nothing] * 7) for n in range(len(values_ms))]  # type: ignore[arg-type]
    return time_offsets(tracks, errors, set())[0]


def test_one_radar_that_is_late_is_the_odd_one() -> None:
    (found,) = offsets((5.0, -60.0, 0.0, -5.0))
    assert (found.radars, found.unit) == (("1",), "ms")
    assert found.value == pytest.approx(60.0)


def test_of_two_radars_that_differ_none_is_blamed() -> None:
    assert offsets((57.0, -27.0)) == []


def test_a_late_radar_is_measured_by_what_is_mended_besides() -> None:
    """All are late, one later: each gets its own. Ego motion is late: that mends all, and the odd one needs the rest alone."""
    every, later = sorted(offsets((-100.0, -190.0, -100.0, -100.0)), key=lambda one: len(one.radars), reverse=True)
    assert (every.radars, later.radars) == (("0", "2", "3"), ("1",))
    assert (every.value, later.value) == pytest.approx((100.0, 190.0), abs=1.0)
    motion, odd = sorted(offsets((100.0, 10.0, 100.0, 100.0)), key=lambda one: len(one.radars))
    assert (motion.subject, odd.radars) == ("motion", ("1",))
    assert (motion.value, odd.value) == pytest.approx((100.0, 90.0), abs=1.0)


@pytest.mark.parametrize("seed", range(3))
def test_offsets_within_the_limit_are_nobodys_fault(seed: int) -> None:
    random = np.random.default_rng(seed)
    assert offsets((random.uniform(-0.4, 0.4, 4) * LIMIT * 1e3).tolist()) == []
