"""A short piece of the way, and what wheels and gyro said on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from echogrid.core.motion.se2 import SE2


@dataclass(slots=True)
class Leg:
    """Integrals over its time, uncorrected: `speed` in m, `yaw_rate` in rad, `difference` of the rear wheels in m."""

    begin: SE2
    seconds: float = 0.0
    speed: float = 0.0
    yaw_rate: float = 0.0
    difference: float = 0.0

    def add(self, seconds: float, speed: float, yaw_rate: float, difference: float) -> None:
        """Goes on for so long with this (m/s, rad/s, m/s)."""
        self.seconds += seconds
        self.speed += seconds * speed
        self.yaw_rate += seconds * yaw_rate
        self.difference += seconds * difference

    @staticmethod
    def joined(legs: Sequence[Leg]) -> Leg:
        """At least one."""
        whole = Leg(legs[0].begin)
        for leg in legs:
            whole.seconds += leg.seconds
            whole.speed += leg.speed
            whole.yaw_rate += leg.yaw_rate
            whole.difference += leg.difference
        return whole
