"""The figures by which simulated and recorded drives are set side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import fold, static_range_rate
from echogrid_training.recording import Recording, Truth
from echogrid_training.sensors.episode import NEAR

GROSS = 1.0  # m/s: a larger range-rate residual of a standing thing is no noise but an error
FAR_OFF = 1.0  # m: a detection with no surface within is a ghost, clutter, or of something that the lidar does not see
RINGS = ((0.0, 7.0), (7.0, 14.0), (14.0, 21.0))  # m
STEP_NS = 50_000_000  # over twice this the true motion is averaged


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """What one drive's radars reported within NEAR."""

    counts: NDArray[np.int64]  # (S,) detections of each scan
    residual: Floats  # (N,) m/s, range rate less that of a standing point
    sensor: NDArray[np.int64]  # (N,) number of the radar
    rcs: Floats  # (N,) dBsm


def detections(recording: Recording, standing: Sequence[NDArray[np.bool_]] | None = None) -> Detections:
    """`standing`: per scan, which detections are of standing things (residuals are taken of those alone); None: all are taken."""
    mounts = {radar.name: (n, Mount(radar.base_from_sensor, radar.fov / 2, NEAR)) for n, radar in enumerate(recording.radars)}
    counts, residual, sensor, rcs = [], [], [], []
    for index, scan in enumerate(recording.scans):
        near = scan.range < NEAR
        counts.append(int(near.sum()))
        motion = motion_at(recording.truth, scan.stamp_ns)
        if motion is None:
            continue
        number, mount = mounts[scan.sensor]
        kept = near if standing is None else near & standing[index]
        residual.append(residual_of(scan, mount, *motion)[kept])
        sensor.append(np.full(int(kept.sum()), number))
        rcs.append(scan.rcs[near])
    return Detections(np.array(counts), np.concatenate(residual), np.concatenate(sensor), np.concatenate(rcs))


def residual_of(scan: RadarScan, mount: Mount, speed: float, yaw_rate: float) -> Floats:
    """(N,) m/s: range rate less that of standing points, the Doppler ambiguity folded."""
    expected, _ = static_range_rate(scan.azimuth, mount, speed, yaw_rate)
    return fold(scan.range_rate - expected, scan.ambiguity)


def motion_at(truth: Truth, stamp_ns: int) -> tuple[float, float] | None:
    """True speed (m/s) and yaw rate (rad/s) of base, from poses 50 ms before and after; None at the drive's ends."""
    around = np.array((stamp_ns - STEP_NS, stamp_ns + STEP_NS))
    if around[0] < truth.stamp_ns[0] or around[1] > truth.stamp_ns[-1]:
        return None
    seconds = (truth.stamp_ns - truth.stamp_ns[0]) * 1e-9
    x, y, yaw = (np.interp((around - truth.stamp_ns[0]) * 1e-9, seconds, column) for column in (truth.x, truth.y, truth.yaw))
    heading, span = yaw.mean(), 2e-9 * STEP_NS
    ahead = (x[1] - x[0]) * np.cos(heading) + (y[1] - y[0]) * np.sin(heading)
    return float(ahead / span), float((yaw[1] - yaw[0]) / span)


def spread(values: Floats) -> float:
    """Robust sigma: 1.4826 times the median distance from the median."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


def biases(found: Detections) -> list[float]:
    """Median residual of each radar, m/s."""
    return [float(np.median(found.residual[found.sensor == number])) for number in np.unique(found.sensor)]


def gross_share(residual: Floats) -> float:
    """Share of residuals beyond GROSS."""
    return float(np.mean(np.abs(residual) > GROSS))


def surface_distance(places: Floats, surfaces: Floats) -> Floats:
    """(N,) m from each detection (N, 2) to the nearest lidar point (M, 2)."""
    distance: Floats = cKDTree(surfaces).query(places)[0]
    return distance


def by_ring(range_: Floats, distance: Floats) -> list[tuple[float, float]]:
    """For each of RINGS: the median distance to a surface (m), and the share of detections with none within FAR_OFF; NaN if empty."""
    rows = []
    for low, high in RINGS:
        ring = distance[(range_ >= low) & (range_ < high)]
        rows.append((float(np.median(ring)), float(np.mean(ring > FAR_OFF))) if len(ring) else (float("nan"), float("nan")))
    return rows
