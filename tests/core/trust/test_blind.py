"""Which radar is called blocked: the one that misses what it could have seen, and none beside an open field."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.health import SensorHealth
from echogrid.core.messages import RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep
from echogrid.core.trust.watch import Watch

MOUNTS = {
    name: Mount(SE2(x, y, math.radians(yaw)), math.radians(75), 25.0)
    for name, x, y, yaw in (("fl", 3.7, 0.8, 50), ("fr", 3.7, -0.8, -50), ("rl", -0.8, 0.8, 130), ("rr", -0.8, -0.8, -130))
}
SPEED, STEP_NS, NOISE = 8.0, 70_000_000, GateNoise()


def scan(name: str, n: int, posts: np.ndarray, chance: float, rng: np.random.Generator) -> PlacedScan:
    """What a radar sees of posts (N, 2) in odom: each with a chance, those beyond 25 m too, up to 60 m."""
    stamp, mount = n * STEP_NS, MOUNTS[name]
    ego = EgoState(stamp, SE2(SPEED * stamp * 1e-9, 0.0, 0.0), SPEED, 0.0)
    x, y = (ego.odom_from_base @ mount.base_from_sensor).inverse().apply(posts).T
    range_, azimuth = np.hypot(x, y), np.arctan2(y, x)
    seen = (range_ < 60) & (np.abs(azimuth) < mount.half_fov) & (rng.uniform(size=len(x)) < chance)
    rate = -SPEED * np.cos(azimuth[seen] + mount.base_from_sensor.yaw)
    whole = RadarScan(name, stamp, stamp, range_[seen], azimuth[seen], rate, np.zeros(seen.sum()))
    return PlacedScan(whole, mount, ego)


def hear(watch: Watch, one: PlacedScan) -> None:
    radar = watch.radars[one.scan.sensor]
    radar.health.complete += 1
    radar.hear(one.scan)


def drive(posts: np.ndarray, chance: float, blocked: tuple[str, int] | None = None, scans: int = 400) -> dict[str, list[int]]:
    """The numbers of the scans at which each radar was called blocked."""
    watch, rng = Watch(MOUNTS, {name: SensorHealth() for name in MOUNTS}, NOISE), np.random.default_rng(1)
    found: dict[str, list[int]] = {name: [] for name in MOUNTS}
    for n in range(1, scans):
        silent = () if blocked is None or n < blocked[1] else blocked[0].split()
        cycle = [scan(name, n, posts, 0.0 if name in silent else chance, rng) for name in MOUNTS]
        for one in cycle:
            hear(watch, one)
        watch.judge(Sweep.of(cycle, NOISE))
        for name in MOUNTS:
            if any("blocked" in sentence for sentence in watch.radars[name].doubts.values()):
                found[name].append(n)
    return found


def street(left_ends: float = 1e9) -> np.ndarray:
    """A post every 2 m on both sides, 8 m from the line; on the left none beyond `left_ends` m of way."""
    x = np.arange(-60.0, 400.0, 2.0)
    left = x[x < left_ends]
    return np.concatenate([np.stack((x, np.full_like(x, -8.0)), 1), np.stack((left, np.full_like(left, 8.0)), 1)])


@pytest.mark.parametrize("chance", [0.1, 0.5])
def test_a_healthy_radar_beside_an_open_field_is_not_called_blocked(chance: float) -> None:
    found = drive(street(left_ends=100.0), chance)
    assert not any(found.values())


@pytest.mark.parametrize("name", ["fl", "rr"])
def test_a_radar_that_sees_nothing_where_others_see_something_is_called_blocked_within_three_seconds(name: str) -> None:
    found = drive(street(), 0.5, (name, 150))
    assert 150 < found[name][0] < 150 + 3e9 / STEP_NS
    assert not any(found[other] for other in MOUNTS if other != name)


def test_where_most_see_nothing_none_is_called_blocked() -> None:
    """A tunnel's end, or a field on both sides: no radar sees what it usually does but one."""
    assert not any(drive(street(), 0.5, ("fl fr rr", 100), scans=200).values())


def test_a_radar_that_sees_again_is_believed_again() -> None:
    watch, rng = Watch(MOUNTS, {name: SensorHealth() for name in MOUNTS}, NOISE), np.random.default_rng(1)
    for n in range(1, 300):
        cycle = [scan(name, n, street(), 0.0 if name == "rl" and 150 <= n < 250 else 0.5, rng) for name in MOUNTS]
        for one in cycle:
            hear(watch, one)
        watch.judge(Sweep.of(cycle, NOISE))
        if n == 249:
            assert "blind" in watch.radars["rl"].doubts
    assert "blind" not in watch.radars["rl"].doubts
