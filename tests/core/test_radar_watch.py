"""A radar is measured against what was usual for it, and the usual is what was on time."""

from __future__ import annotations

import numpy as np

from echogrid.core.health import SensorHealth
from echogrid.core.messages import RadarScan
from echogrid.core.mount import Mount
from echogrid.core.radar_watch import RadarWatch
from echogrid.core.se2 import IDENTITY

CYCLE_NS = 50_000_000


def heard(lags: list[float]) -> list[bool]:
    """Whether each of some scans, so many seconds late by their counter, leaves the radar doubted."""
    health = SensorHealth()
    watch = RadarWatch(Mount(IDENTITY, 1.2, 25.0), health)
    rng = np.random.default_rng(1)
    found = []
    for n, lag in enumerate(lags):
        stamp = n * CYCLE_NS + round(lag * 1e9)
        ranges = rng.uniform(3.0, 20.0, (4, 20))  # another scene each time
        scan = RadarScan("front", stamp, stamp, ranges[0], np.zeros(20), np.zeros(20), np.zeros(20), lag=lag)
        health.complete += 1
        watch.hear(scan)
        watch.look(scan, 5.0)
        found.append("lags" in watch.doubts)
        if found[-1]:
            assert watch.doubts["lags"] == "shifted in time: its scans come 300 ms later than their counter says"
    return found


def test_a_radar_whose_first_scans_were_late_is_not_doubted_once_it_is_on_time() -> None:
    """A machine that was slow to start: its counter shows the later ones early, which no frame is."""
    assert not any(heard([0.0] * 3 + [-0.137] * 100))


def test_a_radar_that_falls_behind_is_doubted_until_it_is_on_time() -> None:
    assert heard([0.0] * 20 + [0.3] + [0.0] * 20) == [False] * 20 + [True] + [False] * 20
    assert heard([0.0] * 3 + [-0.1] * 20 + [0.2] + [-0.1] * 5) == [False] * 23 + [True] + [False] * 5
