"""What the range rates of standing things say about wheel scale and mounts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.core.motion.error_model import BIAS, CAR, DELAY, HEADING, POSE, RATE, SCALE, STRETCH, TURN_SCALE, YAW, X, Y
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.static_gate import GateNoise

PERIOD_NS = 200_000_000  # scans that follow sooner only repeat what was said
SLOWEST = 1.0  # m/s: of a slower car nothing is learned
LEAST, MOST = 5, 10  # detections of a scan: fewer are not used, more count as so many
CORRELATED = 6.0  # scans that are worth one: what disturbs one disturbs its neighbours
DISTORTED = 0.1  # rad: azimuth errors as a radome makes them, which no number of detections averages out
SLIPPING = 0.33  # m/s²: an acceleration at which wheels slip about as much as they are off otherwise


class DopplerErrors:
    """Remembers when the range rates were last compared."""

    def __init__(self) -> None:
        self._newest_ns: int | None = None

    def restart(self) -> None:
        """Times begin anew."""
        self._newest_ns = None

    def add(self, placed: Sequence[PlacedScan], errors: ErrorFilter, noise: GateNoise) -> None:
        """One cycle's scans of trusted radars."""
        moving = [one for one in placed if not -SLOWEST < one.ego.speed < SLOWEST and one.scan.range.size >= LEAST]
        if not moving or errors.learns != "driving":
            return
        newest_ns = max([one.ego.stamp_ns for one in moving])
        if self._newest_ns is not None and newest_ns - self._newest_ns < PERIOD_NS:
            return
        self._newest_ns = newest_ns
        count = len(errors.mean)
        information, vector = np.zeros((count, count)), np.zeros(count)
        for one in moving:
            rows = rows_of(errors, one.scan.sensor)
            slope, left, weight = equations(one, errors, noise)
            weighted = slope * weight[:, None]
            information[rows[:, None], rows] += weighted.T @ slope
            vector[rows] += weighted.T @ left
        radars = range(POSE + CAR, count)
        errors.see(information, vector, (X, Y, HEADING, SCALE, DELAY, *radars))


def rows_of(errors: ErrorFilter, radar: str) -> NDArray[np.intp]:
    """The errors that bend this radar's range rates, by their places in the filter."""
    own = errors.places[radar]
    return np.array((SCALE, BIAS, TURN_SCALE, DELAY, own + YAW, own + STRETCH, own + RATE))


def equations(one: PlacedScan, errors: ErrorFilter, noise: GateNoise) -> tuple[Floats, Floats, Floats]:
    """Of each detection the derivatives of its range rate by the errors (N, 7), in the order of `rows_of`; what the estimated errors leave
    of it (N,) m/s; and its weight (N,), an inverse variance, 0 for what does not stand.
    """
    scan, place, ego = one.scan, one.mount.base_from_sensor, one.ego
    rows = rows_of(errors, scan.sensor)
    scale, bias, turn_scale, delay, yaw, stretch, rate = errors.mean[rows].tolist()
    wheels, gyro = ego.speed / (1.0 + errors.scale), ego.yaw_rate + errors.bias
    bearing, count = scan.azimuth * (1.0 + stretch) + (place.yaw + yaw), scan.range.size
    slope, left, weight = np.empty((count, len(rows))), np.empty(count), np.empty(count)
    loops.leanings(
        *(np.cos(bearing), np.sin(bearing), scan.azimuth, scan.range_rate, place.x, place.y, wheels, gyro),
        wheels * (1.0 + scale) + delay * errors.acceleration,
        gyro * (1.0 + turn_scale) - bias + delay * errors.turn_acceleration,
        *(errors.acceleration, errors.turn_acceleration, rate, scan.ambiguity, errors.covariance[rows[:, None], rows]),
        *(noise.range_rate, noise.azimuth, DISTORTED, noise.sigmas),
        *(CORRELATED, MOST, 1.0 + (errors.acceleration / SLIPPING) ** 2),
        *(slope, left, weight),
    )
    return slope, left, weight
