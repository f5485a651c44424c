"""A car that drives, in a few arrays: its true way, and what wheels, gyro and radars with known errors show of it. No town, no CAN."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from echogrid.core.messages import Floats, RadarScan, Speed, YawRate
from echogrid.core.motion.error_filter import ErrorFilter, Learns
from echogrid.core.motion.odometry import Odometry
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.doppler_errors import DopplerErrors
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.seen_again import SeenAgain
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep

STEP = 0.02  # s
MS = 1_000_000
MOUNTS = {
    name: Mount(SE2(x, y, math.radians(yaw)), math.radians(75.0), 25.0)
    for name, (x, y, yaw) in {
        "front_left": (3.6, 0.8, 45.0),
        "front_right": (3.6, -0.8, -45.0),
        "rear_left": (-0.8, 0.8, 135.0),
        "rear_right": (-0.8, -0.8, -135.0),
    }.items()
}


@dataclass(frozen=True)
class Errors:
    """In the terms of core/motion/error_model.py; `yaws` and `rates` of each radar."""

    scale: float = 0.0
    bias: float = 0.0
    turn_scale: float = 0.0
    track: float = 1.55
    uneven: float = 0.0
    yaws: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    rates: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)


@dataclass
class Driven:
    """Truth and samples: time (N,) s, speed (N,) m/s, yaw_rate (N,) rad/s; wheels, difference and gyro (N,) as shown."""

    speed: Floats
    yaw_rate: Floats
    errors: Errors
    seed: int = 0
    moving: float = 0.0  # share of the detections that do not stand
    one_signal: bool = False  # both wheels are the same
    detections: int = 24
    time: Floats = field(init=False)
    way: Floats = field(init=False)  # (N, 3) true x, y, yaw

    def __post_init__(self) -> None:
        rng, errors, count = np.random.default_rng(self.seed), self.errors, len(self.speed)
        self.time = np.arange(count) * STEP
        turned = np.concatenate(([0.0], np.cumsum((self.yaw_rate[1:] + self.yaw_rate[:-1]) / 2 * STEP)))
        middle, speed = (turned[1:] + turned[:-1]) / 2, (self.speed[1:] + self.speed[:-1]) / 2 * STEP
        x, y = (np.concatenate(([0.0], np.cumsum(speed * part(middle)))) for part in (np.cos, np.sin))
        self.way = np.stack((x, y, turned), axis=1)
        turns = np.abs(self.speed) > 0.0
        self.wheels = np.where(turns, self.speed / (1.0 + errors.scale) + rng.normal(0.0, 0.01, count), 0.0)
        self.gyro = (self.yaw_rate + errors.bias) / (1.0 + errors.turn_scale) + rng.normal(0.0, 0.002, count)
        apart = errors.track * self.yaw_rate + errors.uneven * self.speed + rng.normal(0.0, 0.01, count)
        self.difference = np.where(turns & (not self.one_signal), apart, 0.0)
        self._rng = rng

    def scan(self, radar: int, n: int) -> RadarScan:
        """What a radar shows at sample n."""
        name, mount = list(MOUNTS.items())[radar]
        place, rng = mount.base_from_sensor, self._rng
        azimuth = rng.uniform(-1.2, 1.2, self.detections)
        bearing = azimuth + place.yaw + self.errors.yaws[radar]
        vx, vy = self.speed[n] - self.yaw_rate[n] * place.y, self.yaw_rate[n] * place.x
        rate = -(vx * np.cos(bearing) + vy * np.sin(bearing)) + self.errors.rates[radar] + rng.normal(0.0, 0.1, len(azimuth))
        rate += np.where(rng.uniform(size=len(azimuth)) < self.moving, rng.uniform(-15.0, 15.0, len(azimuth)), 0.0)
        shown = azimuth + rng.normal(0.0, 0.015, len(azimuth))
        stamp_ns = round(self.time[n] * 1e9)
        return RadarScan(name, stamp_ns, stamp_ns, rng.uniform(2.0, 20.0, len(azimuth)), shown, rate, np.zeros(len(azimuth)))


def follow(driven: Driven, learns: Learns = "driving", errors: ErrorFilter | None = None, again: SeenAgain | None = None) -> Odometry:
    """All of it through dead reckoning and the filter; `again`: what is seen again, too."""
    errors = ErrorFilter(tuple(MOUNTS), learns) if errors is None else errors
    odometry, doppler, noise = Odometry(errors), DopplerErrors(), GateNoise()
    for n, time in enumerate(driven.time):
        stamp_ns = round(time * 1e9)
        odometry.add(Speed(stamp_ns, float(driven.wheels[n]), difference=float(driven.difference[n])))
        odometry.add(YawRate(stamp_ns, float(driven.gyro[n])))
        if n % 5:
            continue
        placed = []
        for radar, mount in enumerate(MOUNTS.values()):
            ego, scan = odometry.at(stamp_ns), driven.scan(radar, n)
            if ego is not None:
                placed.append(PlacedScan(scan, mount, ego))
        doppler.add(placed, errors, noise)
        if again is not None and placed:
            again.add(Sweep.of(placed, noise), errors, noise)
    return odometry


def town(seconds: float, seed: int = 0) -> tuple[Floats, Floats]:
    """Speed and yaw rate of a drive with turns, between 1.5 and 13 m/s."""
    time, phase = np.arange(round(seconds / STEP)) * STEP, np.random.default_rng(seed).uniform(0.0, 2 * math.pi, 2)
    speed = 7.0 + 5.5 * np.sin(2 * math.pi * time / 25.0 + phase[0])
    return speed, 0.35 * np.sin(2 * math.pi * time / 14.0 + phase[1]) * (speed < 9.0)
