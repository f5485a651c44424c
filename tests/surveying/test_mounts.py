"""Mounts by Doppler: of what stands, and of nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid.core.messages import RadarScan, Speed, YawRate
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.judging.recorded import collect
from echogrid.surveying.mounts import Seen, seen

YAW = math.radians(30.0)
TOLD = {"one": Mount(SE2(0.0, 0.0, 0.0), math.radians(75), 60.0)}


def told(ahead: float) -> Seen | None:
    """Of a radar at (3.0, 0.5) that sees what drives along with this share of the car's speed, now faster, now slower; 0: what stands."""
    random = np.random.default_rng(2)
    motion: list[Speed | YawRate] = []
    scans = []
    for n in range(600):
        stamp, time = n * 50_000_000, n * 0.05
        speed, rate = 10.0 + 3.0 * math.sin(0.5 * time), 0.2 * math.sin(0.3 * time)
        motion += [Speed(stamp, speed), YawRate(stamp, rate)]
        azimuth = random.uniform(-1.0, 1.0, 12)
        along = speed - (rate * 0.5) - ahead * (speed + 4.0 * math.sin(0.21 * time))
        velocity = np.array((along, rate * 3.0))
        own = -velocity @ np.stack((np.cos(azimuth + YAW), np.sin(azimuth + YAW))) + random.normal(0.0, 0.1, 12)
        scans.append(RadarScan("one", stamp, stamp, random.uniform(5, 50, 12), azimuth, own, np.full(12, np.nan)))
    recorded = collect(motion, scans, TOLD)
    return seen(recorded.radars[0], recorded.speed, recorded.yaw_rate)


def test_of_standing_things_a_mount_is_made() -> None:
    found = told(0.0)
    assert found is not None
    assert found.yaw == pytest.approx(YAW, abs=math.radians(0.5))
    assert (found.x, found.y) == pytest.approx((3.0, 0.5), abs=0.2)


def test_of_traffic_none_is_made() -> None:
    assert told(1.0) is None
