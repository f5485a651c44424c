"""Radars like those of a car that was driven: what its drives show is kept, and the rest is drawn anew for every town.

A network learns best from towns that are seen as the car sees streets (training/LOG.md); only a simulated one knows the truth of them.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs

from echogrid.config.tables import Body
from echogrid.core.motion.se2 import SE2
from echogrid_training.recording import RadarMount, Recording
from echogrid_training.sensors.episode import NEAR, Episode, draw_episode, sparse_sensors

CLUSTERED = 24.0  # detections within NEAR; below that, a radar may report clusters, and in half of the towns it does
LEAST_REACH = 25.0  # m: what is farther is not rastered, but a radar's power is set by what it detects within NEAR


@dataclass(frozen=True, slots=True)
class Radar:
    """One radar as it is configured, and how far its azimuths seem to be off."""

    name: str
    x: float  # m in base
    y: float
    yaw: float  # rad
    fov: float  # rad
    azimuth_bias: float  # rad that azimuths are too large
    azimuth_sigma: float  # rad, of that


@dataclass(frozen=True, slots=True)
class Likeness:
    """What drives show of a car."""

    body: Body
    radars: tuple[Radar, ...]
    cycle: float  # s
    density: float  # mean detections of a radar's scan within NEAR
    most: int  # detections in a scan
    reach: float  # m, of the farthest
    ambiguity: float  # m/s, of the range rate; 0: none
    rcs: float | None  # dBsm, median within NEAR; None where the radars report none


def episode_like(car: Likeness, seed: int, family: str) -> Episode:
    """Always the same of a seed and a family."""
    rng = np.random.default_rng((seed, zlib.crc32(family.encode()), 3))
    clustered = car.density < CLUSTERED and rng.uniform() < 0.5
    drawn = sparse_sensors(seed, family, car.density) if clustered else draw_episode(seed, family, car.density)
    radar = replace(
        drawn.radar,
        half_fov=max(one.fov for one in car.radars) / 2,
        cycle=car.cycle,
        most=car.most,
        max_range=max(car.reach, LEAST_REACH),
        ambiguity=car.ambiguity,
    )
    corners = tuple(
        replace(
            drawn.corners[index % len(drawn.corners)],
            mount=RadarMount(one.name, SE2(one.x, one.y, one.yaw), one.fov),
            azimuth_bias=float(rng.normal(one.azimuth_bias, one.azimuth_sigma)),
        )
        for index, one in enumerate(car.radars)
    )
    return replace(drawn, body=car.body, radar=radar, corners=corners)


def as_loud(recording: Recording, rcs: float | None) -> Recording:
    """With cross-sections whose median within NEAR is `rcs` dBsm; with none where it is None."""
    near = np.concatenate([np.empty(0), *(scan.rcs[scan.range < NEAR] for scan in recording.scans)])
    change = math.nan if rcs is None or not len(near) else rcs - float(np.median(near))
    return replace(recording, scans=[structs.replace(scan, rcs=scan.rcs + change) for scan in recording.scans])
