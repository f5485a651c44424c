"""A recording as arrays: what was decoded of each radar and of ego motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import EgoMotion, Floats, RadarScan, Speed
from echogrid.core.radar.mount import Mount

NS = 1e-9
PAUSE = 0.5  # s without a sample or scan of anybody
Stamps = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One signal: its values (N,) and when they were measured (N,), s from the recording's begin, in order of their times."""

    time: Floats
    value: Floats

    def __len__(self) -> int:
        return len(self.time)

    def at(self, time: Floats) -> Floats:
        """Linear between two samples, the nearest one's outside; NaN where there is none."""
        return np.interp(time, self.time, self.value) if len(self) else np.full(np.shape(time), np.nan)

    def rate(self, time: Floats, step: float = 0.1) -> Floats:
        """Change in a second, over `step` s around each time."""
        return (self.at(time + step / 2) - self.at(time - step / 2)) / step


@dataclass(frozen=True, slots=True, eq=False)
class RadarTrack:
    """One radar's scans one after the other: scan i has the detections `first[i]` to `first[i + 1]`, in the sensor's frame.

    time (S,) s from the recording's begin, first (S + 1,), range (N,) m, azimuth (N,) rad, range_rate (N,) m/s, ambiguity (S,) m/s,
    blockage (S,) 0 … 1.
    """

    name: str
    mount: Mount
    time: Floats
    first: NDArray[np.intp]
    range: Floats
    azimuth: Floats
    range_rate: Floats
    ambiguity: Floats
    blockage: Floats

    def __len__(self) -> int:
        return len(self.time)

    @property
    def counts(self) -> NDArray[np.intp]:
        """(S,) detections of each scan."""
        return np.diff(self.first)

    @property
    def scan(self) -> NDArray[np.intp]:
        """(N,) each detection's scan."""
        return np.repeat(np.arange(len(self)), self.counts)


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """All that was decoded. `begin_ns` is the time that the tracks' times count from."""

    begin_ns: int
    speed: Track  # m/s
    yaw_rate: Track  # rad/s
    radars: tuple[RadarTrack, ...]
    difference: Track  # m/s by which the right rear wheel is faster than the left one

    @property
    def seconds(self) -> float:
        times = self._times
        return float(times[-1] - times[0]) if len(times) else 0.0

    @property
    def pauses(self) -> Floats:
        """(P, 2) from when until when nobody was heard, s: the recording stood still, or the car slept."""
        times = self._times
        before = np.flatnonzero(np.diff(times) > PAUSE)
        return np.stack((times[before], times[before + 1]), axis=1) if len(before) else np.empty((0, 2))

    def steps(self, time: Floats) -> Floats:
        """(N - 1,) s between times (N,) of one of those that are recorded, without pauses."""
        pauses = self.pauses
        if not len(pauses):
            return np.diff(time)
        passed = np.cumsum(np.stack((np.zeros(len(pauses)), pauses[:, 1] - pauses[:, 0]), axis=1).ravel())
        return np.diff(time - np.interp(time, pauses.ravel(), passed))

    @property
    def _times(self) -> Floats:
        """Of all samples and scans, in their order."""
        return np.sort(np.concatenate([self.speed.time, self.yaw_rate.time, *(radar.time for radar in self.radars)]))


def collect(motion: Sequence[EgoMotion], scans: Sequence[RadarScan], mounts: dict[str, Mount]) -> Recorded:
    """Arrays of what a decoder gave, in any order."""
    begin_ns = min((one.stamp_ns for one in (*motion, *scans)), default=0)
    speeds = [(one.stamp_ns, one.speed) for one in motion if isinstance(one, Speed)]
    rates = [(one.stamp_ns, one.yaw_rate) for one in motion if not isinstance(one, Speed)]
    by_radar: dict[str, list[RadarScan]] = {name: [] for name in mounts}
    for scan in scans:
        by_radar[scan.sensor].append(scan)
    radars = tuple(_radar(name, mounts[name], found, begin_ns) for name, found in by_radar.items())
    apart = [(one.stamp_ns, one.difference) for one in motion if isinstance(one, Speed)]
    return Recorded(begin_ns, _track(speeds, begin_ns), _track(rates, begin_ns), radars, _track(apart, begin_ns))


def _track(samples: list[tuple[int, float]], begin_ns: int) -> Track:
    samples = sorted(samples)
    return Track(np.array([(stamp - begin_ns) * NS for stamp, _ in samples]), np.array([value for _, value in samples]))


def _radar(name: str, mount: Mount, scans: list[RadarScan], begin_ns: int) -> RadarTrack:
    scans = sorted(scans, key=lambda scan: scan.stamp_ns)
    joined = {
        key: np.concatenate([getattr(scan, key) for scan in scans]) if scans else np.empty(0) for key in ("range", "azimuth", "range_rate")
    }
    return RadarTrack(
        name,
        mount,
        np.array([(scan.stamp_ns - begin_ns) * NS for scan in scans]),
        np.concatenate(([0], np.cumsum([len(scan) for scan in scans]))).astype(np.intp),
        joined["range"],
        joined["azimuth"],
        joined["range_rate"],
        np.array([scan.ambiguity for scan in scans]),
        np.array([scan.blockage for scan in scans]),
    )
