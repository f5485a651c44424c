"""A street of posts past which a car drives straight on, as its four corner radars would have recorded it without noise."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from echogrid.core.motion.se2 import SE2
from echogrid_training.recording import EPOCH_NS

SPEED = 5.0  # m/s
SECONDS = 3.0
PERIODS_NS = (71_000_000, 74_000_000, 77_000_000, 80_000_000)  # all different, so that scans left out are of every radar in turn
POSTS = np.array([(x, side * 5.0) for x in np.arange(-20.0, 36.0, 4.0) for side in (-1, 1)])  # (N, 2) m in the first pose's frame
MOUNTS = {
    "front_left": SE2(3.4, 0.6, math.radians(50)),
    "front_right": SE2(3.4, -0.6, math.radians(-50)),
    "rear_left": SE2(-0.5, 0.6, math.radians(130)),
    "rear_right": SE2(-0.5, -0.6, math.radians(-130)),
}
REACH, HALF_FOV = 18.0, math.radians(60)
MOTION_NS = np.arange(EPOCH_NS - 100_000_000, EPOCH_NS + round(SECONDS * 1e9), 10_000_000)


def pose(stamp_ns: int) -> SE2:
    """Of base."""
    return SE2(SPEED * (stamp_ns - int(MOTION_NS[0])) * 1e-9, 0.0, 0.0)


def scans() -> Iterator[tuple[str, int, np.ndarray]]:
    """Sensor, stamp, and (N, 4) range, azimuth, range rate and RCS."""
    for period, (sensor, mount) in zip(PERIODS_NS, MOUNTS.items(), strict=True):
        for stamp in range(EPOCH_NS, int(MOTION_NS[-1]) - 50_000_000, period):
            x, y = (pose(stamp) @ mount).inverse().apply(POSTS).T
            range_, azimuth = np.hypot(x, y), np.arctan2(y, x)
            rate = -SPEED * np.cos(azimuth + mount.yaw)  # the sensor comes nearer by its speed along the line of sight
            seen = (range_ < REACH) & (np.abs(azimuth) < HALF_FOV)
            yield sensor, stamp, np.stack((range_, azimuth, rate, np.full(len(x), 5.0)), axis=-1)[seen]
