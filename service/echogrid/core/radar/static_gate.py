"""Tells the reflections of standing things from those of moving ones by their range rate.

A static point at azimuth a (in base) shows the range rate -u(a)·v_sensor: u the unit vector from the sensor to the point, v_sensor the
sensor's own velocity over ground, which for a mount at (x, y) on a car with speed v and yaw rate w is (v - w y, w x).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats
from echogrid.core.radar.mount import Mount


@dataclass(frozen=True, slots=True)
class GateNoise:
    """One-sigma errors of what the gate compares, how many sigmas still count as static, and how far a mover reaches.

    The range-rate sigma is what the recordings in docs/real_data.md show (0.07–0.17 m/s) with the sensors' quantisation.
    """

    range_rate: float = 0.13  # m/s
    azimuth: float = 0.03  # rad
    speed: float = 0.01  # of the speed
    yaw_rate: float = 0.005  # rad/s
    sigmas: float = 3.0
    mover_radius: float = 2.5  # m: half the length of a car


def static_range_rate(azimuth: Floats, mount: Mount, speed: float, yaw_rate: float) -> tuple[Floats, Floats]:
    """What static points would show: their range rate (N,) m/s, and its derivative by azimuth (N,) m/s/rad.

    azimuth: (N,) rad in the sensor's frame; speed m/s and yaw_rate rad/s of base.
    """
    bearing = azimuth + mount.base_from_sensor.yaw
    vx = speed - yaw_rate * mount.base_from_sensor.y
    vy = yaw_rate * mount.base_from_sensor.x
    cos, sin = np.cos(bearing), np.sin(bearing)
    return -(vx * cos + vy * sin), vx * sin - vy * cos


def fold(residual: Floats, ambiguity: float) -> Floats:
    """The smallest value equal to `residual` modulo the Doppler ambiguity interval (m/s; 0: unambiguous)."""
    if ambiguity <= 0.0:
        return residual
    return residual - ambiguity * np.round(residual / ambiguity)


def deviation(
    azimuth: Floats,
    range_rate: Floats,
    ambiguity: float,
    mount: Mount,
    speed: float,
    yaw_rate: float,
    noise: GateNoise,
) -> Floats:
    """(N,) how many sigmas the range rate is off a standing point's: static is what has at most `noise.sigmas`. As a `Sweep` has it.

    A sigma grows with what an azimuth error does to the prediction: little ahead, most abeam.
    """
    place = mount.base_from_sensor
    expected, slope = static_range_rate(azimuth, mount, speed, yaw_rate)
    by_azimuth, by_speed, by_turning = slope * noise.azimuth, expected * noise.speed, math.hypot(place.x, place.y) * noise.yaw_rate
    variance = noise.range_rate * noise.range_rate + by_azimuth * by_azimuth + by_speed * by_speed + by_turning * by_turning
    sigmas: Floats = np.abs(fold(range_rate - expected, ambiguity)) / np.sqrt(variance)
    return sigmas


def gated(
    points: Floats, sigmas: Floats, near: NDArray[np.bool_], range_: Floats, reach: float, noise: GateNoise
) -> tuple[NDArray[np.uint8], tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Of detections (N,) at points (N, 2) m, so many sigmas off a standing thing: the verdict (N,) on those that are `near`,
    `kernels.sweeps.GateVerdict`, and of these, and of those up to `reach` m far, which ones stand.

    A car that passes abeam shows no radial speed in the middle and much at its ends: the part between them belongs to it too. One moving
    neighbour is not enough, since one detection in twenty has a gross Doppler error."""
    count = len(points)
    verdicts, static = np.empty(count, np.uint8), np.empty((2, count + 1), np.int64)
    loops.gated(points, sigmas, near, range_, reach, noise.sigmas, noise.mover_radius, verdicts, static)
    one, other = static[:, 0].tolist()
    return verdicts, (static[0, 1 : one + 1], static[1, 1 : other + 1])
