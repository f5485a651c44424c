"""A short piece of the way, and what wheels and gyro said on it."""

from __future__ import annotations

import msgspec

from echogrid.core.motion.se2 import SE2


class Leg(msgspec.Struct, eq=False):
    """Integrals over its time, uncorrected: `speed` in m, `yaw_rate` in rad, `difference` of the rear wheels in m."""

    begin: SE2
    seconds: float = 0.0
    speed: float = 0.0
    yaw_rate: float = 0.0
    difference: float = 0.0

    def join(self, leg: Leg) -> None:
        """Goes on with another."""
        self.seconds += leg.seconds
        self.speed += leg.speed
        self.yaw_rate += leg.yaw_rate
        self.difference += leg.difference
