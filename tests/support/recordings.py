"""Recordings small enough to look at."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from echogrid.config.tables import Body
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid_training.recording import EPOCH_NS, Motion, RadarMount, Recording, truth_from


def scan_of(sensor: str, stamp_ns: int, detections: Floats) -> RadarScan:
    """detections: (N, 4) range, azimuth, range rate, RCS."""
    return RadarScan(sensor, stamp_ns, stamp_ns, *np.asarray(detections, dtype=np.float64).reshape(-1, 4).T)


def random_detections(rng: np.random.Generator, count: int) -> Floats:
    """(N, 4) within every signal's range."""
    low, high = (0.0, -1.6, -80.0, -60.0), (250.0, 1.6, 80.0, 60.0)
    return rng.uniform(low, high, (count, 4))


def make_recording(
    counts: Sequence[int] = (5, 0, 64, 17),
    cycles: int = 10,
    period_ns: int = 50_000_000,
    wheel_speed: Floats | None = None,
    yaw_rate: Floats | None = None,
    scans: list[RadarScan] | None = None,
) -> Recording:
    """Radars r0, r1 … with so many detections per cycle; motion every 10 ms as long as the scans, unless it is given."""
    rng = np.random.default_rng(1)
    radars = tuple(RadarMount(f"r{n}", SE2(1.0, 0.1 * n, 0.5 * n), math.radians(150)) for n in range(len(counts)))
    if scans is None:
        scans = [
            scan_of(radar.name, EPOCH_NS + cycle * period_ns + 7_001_000 * number, random_detections(rng, count))
            for number, (radar, count) in enumerate(zip(radars, counts, strict=True))
            for cycle in range(cycles)
        ]
    if wheel_speed is None:
        wheel_speed = rng.uniform(0, 30, (cycles * period_ns // 10_000_000, 4))
    if yaw_rate is None:
        yaw_rate = rng.uniform(-1, 1, len(wheel_speed))
    stamps = EPOCH_NS + 10_000_000 * np.arange(len(wheel_speed))
    where = np.linspace(3.0, 9.0, len(stamps))
    truth = truth_from(stamps, where, 2 * where, where / 4)
    return Recording("test", Body(), radars, scans, Motion(stamps, wheel_speed, stamps, yaw_rate), truth)
