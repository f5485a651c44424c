"""How sensitive the radars must be to report as many detections as an episode says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echogrid_training.sensors.episode import NEAR, Corner, Episode
from echogrid_training.sensors.radar_model import Sensitivity, Sensor, Surroundings, sense
from echogrid_training.sensors.visibility import Presence

POWERS = (0.0, 65.0)  # dB, between which the density may set the power


@dataclass(frozen=True, slots=True)
class Station:
    """One moment of one radar: all that a scan needs but the radar's sensitivity."""

    corner: Corner
    sensor: Sensor
    traffic: Presence


def sensitivity_for(surroundings: Surroundings, stations: Sequence[Station], episode: Episode) -> Sensitivity:
    """The sensitivity that gives the episode's density on average over the stations, as far as there is enough to see.

    A density below that of a usual radar is reached by arbitrary misses to the share that `thinning` says, and by less power for the rest.
    """
    usual = mean_count(surroundings, stations, episode, Sensitivity())
    wanted = episode.density / max(usual, 1e-6)
    kept = wanted**episode.thinning if wanted < 1 else 1.0
    low, high = POWERS
    for _ in range(7):  # to half a decibel
        middle = (low + high) / 2
        enough = mean_count(surroundings, stations, episode, Sensitivity(middle, kept)) > episode.density
        low, high = (low, middle) if enough else (middle, high)
    return Sensitivity((low + high) / 2, kept)


def mean_count(surroundings: Surroundings, stations: Sequence[Station], episode: Episode, sensitivity: Sensitivity) -> float:
    """Mean number of detections within NEAR at the stations, if no radar is blocked and all they detect is reported."""
    uncapped = replace(episode, radar=replace(episode.radar, most=1 << 20))
    total = 0
    for number, station in enumerate(stations):
        rng = np.random.default_rng((episode.seed, 7, number))
        clear = replace(station.corner, blockage=0.0)
        scan = sense(surroundings, station.traffic, station.sensor, clear, uncapped, sensitivity, rng)
        total += int((scan.range < NEAR).sum())
    return total / len(stations)
