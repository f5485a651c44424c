"""What travels between the steps: frozen, in SI units and radians, stamped with the time of measurement.

`stamp_ns` is the time of measurement (kernel receive time less the age that the sensor reports), `received_ns` the kernel receive time.
Axes: x forward, y left, yaw and azimuth counter-clockwise positive (ISO 8855, REP-103).
"""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class RadarScan(msgspec.Struct, frozen=True, eq=False):
    """All detections of one measurement cycle of one radar, in the sensor's frame (x along boresight)."""

    sensor: str
    stamp_ns: int
    received_ns: int
    range: Floats  # (N,) m
    azimuth: Floats  # (N,) rad, counter-clockwise (left) positive
    range_rate: Floats  # (N,) m/s, d(range)/dt: positive is receding
    rcs: Floats  # (N,) dBsm; NaN where the sensor reports none
    ambiguity: float = 0.0  # m/s: range rates are known modulo this; 0 where unambiguous
    blockage: float = 0.0  # 0 clear … 1 blind
    lag: float = 0.0  # s by which its cycles come later than their counter says; 0 where they have none
    missed: int = 0  # cycles between the last complete one and it, by their counter; 0 where they have none

    def __len__(self) -> int:
        return len(self.range)

    def chosen(self, which: NDArray[np.bool_]) -> RadarScan:
        """The scan with the detections of a mask (N,) alone."""
        if which.all():
            return self
        seen = (self.range[which], self.azimuth[which], self.range_rate[which], self.rcs[which])
        return msgspec.structs.replace(self, range=seen[0], azimuth=seen[1], range_rate=seen[2], rcs=seen[3])


class Speed(msgspec.Struct, frozen=True):
    """Speed of the rear-axle centre along x; negative in reverse."""

    stamp_ns: int
    speed: float  # m/s
    continues: bool = True  # False: by the sender's counter, time has jumped since the last sample
    difference: float = 0.0  # m/s by which the right rear wheel is faster than the left one


class YawRate(msgspec.Struct, frozen=True):
    """Turn rate about z, counter-clockwise positive."""

    stamp_ns: int
    yaw_rate: float  # rad/s
    continues: bool = True


class PoseFix(msgspec.Struct, frozen=True):
    """A pose from outside: where a point of the car is in the map frame, and where the point's x axis shows, each with its own time."""

    stamp_ns: int  # of the place
    x: float  # m
    y: float  # m
    yaw_ns: int
    yaw: float  # rad


EgoMotion = Speed | YawRate
