"""How fast a radar's watch forgets and believes, by its time constants; and that radars which are not trusted have no say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from echogrid.core.health import SensorHealth
from echogrid.core.messages import RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import IDENTITY
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep
from echogrid.core.trust.radar_watch import EVIDENCE, RadarWatch
from echogrid.core.trust.watch import Watch

AHEAD = Mount(IDENTITY, math.radians(60.0), 50.0)
MS = 1_000_000


def scan(at_ns: int, rate: float) -> RadarScan:
    return RadarScan("r", at_ns, at_ns, np.full(8, 9.0), np.zeros(8), np.full(8, rate), np.zeros(8))


def test_a_tenth_of_wild_values_is_reached_with_the_second_wild_scan() -> None:
    """Their share comes near to 1 with 0.8 s: 6 % after 50 ms, 12 % after 100 ms. No road is driven at 90 m/s."""
    watch, begin = RadarWatch(AHEAD, SensorHealth()), 1000 * MS
    for n in range(4):
        watch.hear(scan(begin + 50 * n * MS, 0.0))
    for n, is_wild in ((4, False), (5, True)):
        watch.hear(scan(begin + 50 * n * MS, 90.0))
        assert ("wild" in watch.doubts) == is_wild
    assert "12%" in watch.doubts["wild"]


def test_how_far_it_agrees_is_forgotten_within_seconds() -> None:
    watch = RadarWatch(AHEAD, SensorHealth())
    half = math.exp(-0.5)
    watch.agree(90, 100, 0.0)
    assert watch.agree(0, 0, half) == pytest.approx(0.9)
    assert 100.0 * half * half < EVIDENCE < 100.0 * half
    assert watch.agree(0, 0, half) is None


@pytest.mark.parametrize(("doubted", "support"), [((), 0.5), (("rear",), 1.0), (("front",), 0.0), (("front", "rear"), 0.5)])
def test_what_supports_the_wheels_is_seen_by_trusted_radars(
    doubted: tuple[str, ...], support: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that the front radar sees stands, and nothing that the rear one sees. Where none is trusted, all are asked."""
    watch = Watch(dict.fromkeys(("front", "rear"), AHEAD), {name: SensorHealth() for name in ("front", "rear")}, GateNoise())
    for name in doubted:
        watch.radars[name].doubts["odd"] = "at odds"
    told: list[float] = []
    monkeypatch.setattr(watch.motion, "compare", lambda at_ns, speed, yaw_rate, share, seen: told.append(share) or True)
    scans = [replace(scan(0, rate), sensor=name) for name, rate in (("front", -5.0), ("rear", 9.0))]
    placed = [PlacedScan(one, AHEAD, EgoState(0, IDENTITY, 5.0, 0.0)) for one in scans]
    watch.judge(Sweep.of(placed, GateNoise()))
    assert told == [support]
