"""A street that closes on itself, driven round and round: each lap brings the very same detections, so what differs is the map's doing.

Without CAN, noise and movers: dead reckoning comes back to where it began, to rounding. The car drives at SPEED; four equal bends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from echogrid.core.messages import EgoMotion, Floats, RadarScan, Speed, YawRate
from echogrid.core.motion.odometry import EgoState, Odometry
from echogrid.core.radar.mount import Mount

SPEED = 20.0  # m/s
STRAIGHTS = (1600.0, 660.0)  # m, each twice
BEND = 90.0  # m, radius
MOTION_NS, SCAN_NS = 10_000_000, 50_000_000
SIDE = (5.0, 14.0)  # m beside the street's middle: where things stand
THING = 1.5  # m of street for each
AROUND = 40.0  # m of street in which to look for things
SEEN = 20  # detections of a scan at most
RCS = 5.0  # dBsm


class ClosedStreet:
    """`lap(number)` yields ego motion and scans in the order of their times; `lap_m` and `lap_ns` are a lap's length."""

    def __init__(self, mounts: Mapping[str, Mount], seed: int = 0) -> None:
        self.mounts = mounts
        self.yaw_rates = _yaw_rates()  # (M,) rad/s, one for each MOTION_NS
        self.lap_ns = len(self.yaw_rates) * MOTION_NS
        self.lap_m = len(self.yaw_rates) * MOTION_NS * 1e-9 * SPEED
        self.seed = seed
        self.states = self._drive()  # at each scan's time
        rng = np.random.default_rng(seed)
        along = np.sort(rng.uniform(0.0, self.lap_m, round(self.lap_m / THING)))
        beside = rng.uniform(*SIDE, len(along)) * rng.choice((-1.0, 1.0), len(along))
        at = np.minimum((along / self.lap_m * len(self.states)).astype(int), len(self.states) - 1)
        poses = np.array([(state.odom_from_base.x, state.odom_from_base.y, state.odom_from_base.yaw) for state in self.states])[at]
        things = poses[:, :2] + beside[:, None] * np.stack((-np.sin(poses[:, 2]), np.cos(poses[:, 2])), axis=1)  # (T, 2) m
        self.along = np.concatenate((along - self.lap_m, along, along + self.lap_m))  # (3 T,) m, what comes before and after a lap too
        self.things = np.tile(things, (3, 1))

    def lap(self, number: int, begin_ns: int) -> Iterator[EgoMotion | RadarScan]:
        """The motion of a lap, and every SCAN_NS a scan of each radar, from `begin_ns` + number * lap_ns on."""
        begin_ns += number * self.lap_ns
        for step, yaw_rate in enumerate(self.yaw_rates):
            stamp_ns = begin_ns + step * MOTION_NS
            yield Speed(stamp_ns, SPEED)
            yield YawRate(stamp_ns, float(yaw_rate))
            if (step * MOTION_NS) % SCAN_NS == 0:
                state, here = self.states[step * MOTION_NS // SCAN_NS], step * MOTION_NS * 1e-9 * SPEED
                first, last = np.searchsorted(self.along, (here - AROUND, here + AROUND))
                for index, name in enumerate(self.mounts):
                    rng = np.random.default_rng((self.seed, step, index))
                    yield self._scan(name, state, self.things[first:last], stamp_ns, rng)

    def _drive(self) -> list[EgoState]:
        odometry, states = Odometry(), []
        for step, yaw_rate in enumerate(np.concatenate((self.yaw_rates, self.yaw_rates[:2]))):
            odometry.add(Speed(step * MOTION_NS, SPEED))
            odometry.add(YawRate(step * MOTION_NS, float(yaw_rate)))
            if (step * MOTION_NS) % SCAN_NS == 0:
                states.append(odometry.states[-1])
        closed = states[-1].odom_from_base  # where the next lap begins
        assert math.hypot(closed.x, closed.y) < 1e-3, f"the street does not close: {closed}"
        return states[:-1]

    def _scan(self, name: str, state: EgoState, things: Floats, stamp_ns: int, rng: np.random.Generator) -> RadarScan:
        mount = self.mounts[name]
        sensor_from_odom = (state.odom_from_base @ mount.base_from_sensor).inverse()
        points = sensor_from_odom.apply(things)
        range_, azimuth = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
        seen = np.flatnonzero((range_ < mount.max_range) & (range_ > 1.0) & (np.abs(azimuth) < mount.half_fov))
        seen = rng.permutation(seen)[:SEEN]
        range_, azimuth = range_[seen], azimuth[seen]
        x, y = mount.base_from_sensor.x, mount.base_from_sensor.y
        direction = azimuth + mount.base_from_sensor.yaw
        moves = (state.speed - state.yaw_rate * y) * np.cos(direction) + state.yaw_rate * x * np.sin(direction)
        return RadarScan(name, stamp_ns, stamp_ns, range_, azimuth, -moves, np.full(len(seen), RCS))


def _yaw_rates() -> Floats:
    """Straight, bend, straight, bend, and the same once more; each bend turns by a quarter, so that the second half closes the first."""
    parts = []
    steps = round(BEND * math.pi / 2 / SPEED / (MOTION_NS * 1e-9) / 5) * 5
    for length in STRAIGHTS * 2:
        parts.append(np.zeros(round(length / SPEED / (MOTION_NS * 1e-9) / 5) * 5))
        parts.append(np.full(steps, math.pi / 2 / (steps * MOTION_NS * 1e-9)))
    return np.concatenate(parts)
