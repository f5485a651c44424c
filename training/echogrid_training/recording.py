"""A drive before it is put on a bus: what the radars saw, how the car moved, and where it truly was.

All stamps are times of measurement in ns on one clock. Axes as everywhere in echogrid: x forward, y left, counter-clockwise positive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.config.tables import Body
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2

Stamps = NDArray[np.int64]
Track = Callable[[Iterable[Any], str], Iterable[Any]]  # (things, what is being done) -> the same things, with a progress bar or without

EPOCH_NS = 1_600_000_000_000_000_000  # where drives begin whose source counts from zero: a plausible wall clock, and always the same


def untracked(things: Iterable[Any], _: str) -> Iterable[Any]:
    """No progress bar."""
    return things


@dataclass(frozen=True, slots=True)
class RadarMount:
    """One radar's name, place on the car and full field of view (rad)."""

    name: str
    base_from_sensor: SE2
    fov: float


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What the motion sensors showed: wheel speeds and yaw rate, each at its own times."""

    wheel_stamp_ns: Stamps  # (N,)
    wheel_speed: Floats  # (N, 4) m/s, rear left, rear right, front left, front right; negative in reverse
    yaw_stamp_ns: Stamps  # (M,)
    yaw_rate: Floats  # (M,) rad/s, counter-clockwise positive


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The reference poses of base in the frame of the first of them, so that it is (0, 0, 0); yaw is continuous."""

    stamp_ns: Stamps  # (N,)
    x: Floats  # (N,) m
    y: Floats  # (N,) m
    yaw: Floats  # (N,) rad
    walls: Floats | None = None  # (W, 2, 2) m, the ends of the static surfaces' segments in the same frame, where they are known


@dataclass(frozen=True, slots=True, eq=False)
class LidarTurns:
    """Turns of a lidar, ground and overhead removed: by bearing in the truth's frame, from 0 on in equal steps, the nearest return."""

    stamp_ns: Stamps  # (T,)
    ranges: Floats  # (T, B) m, inf where nothing came back


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Everything of one drive. The scans' `received_ns` is not known before they were on a bus, and is not read."""

    vehicle: str
    body: Body
    radars: tuple[RadarMount, ...]
    scans: list[RadarScan]
    motion: Motion
    truth: Truth
    lidar: LidarTurns | None = None


def truth_from(stamp_ns: Stamps, x: Floats, y: Floats, yaw: Floats, walls: Floats | None = None) -> Truth:
    """Poses of base in any fixed frame (m, rad), and walls in the same, moved into the frame of the first pose."""
    yaw = np.unwrap(yaw)
    cos, sin = np.cos(yaw[0]), np.sin(yaw[0])
    rotation = np.array(((cos, -sin), (sin, cos)))  # row vectors times this: the frame's into the first pose's
    start = np.array((x[0], y[0]))
    points = (np.stack((x, y), axis=-1) - start) @ rotation
    moved = None if walls is None else (walls - start) @ rotation
    return Truth(stamp_ns, points[:, 0], points[:, 1], yaw - yaw[0], moved)
