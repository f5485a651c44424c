"""Where a radar sees, and where it does not."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from echogrid.core.messages import Floats
from echogrid.judging.recorded import RadarTrack

BIN = math.radians(10.0)
DEAD, ALIVE = 0.03, 0.25  # of the median bin inside the field of view
ENOUGH = 60  # detections in that bin
LEAST_BINS = 2
FEW, OTHERS = 0.08, 8.0  # of the others' detections; detections in a scan that those must have
BLIND, OFTEN = 0.5, 0.5  # blockage as the radar says it, in that share of its scans
BEYOND, MUCH = 0.1, 0.1  # rad outside the field of view; share of the detections that is too much, as the service takes it


def by_sector(radar: RadarTrack) -> tuple[Floats, Floats]:
    """Edges (B + 1,) rad of bins from the right to the left end of the field of view, and detections in each (B,)."""
    bins = max(round(2 * radar.mount.half_fov / BIN), 1)
    edges = np.linspace(-radar.mount.half_fov, radar.mount.half_fov, bins + 1)
    return edges, np.histogram(radar.azimuth, edges)[0].astype(float)


def dead_sector(radar: RadarTrack) -> tuple[float, float] | None:
    """From where to where (rad) it sees nothing, though it sees on both sides of it, or in the same sector of its other half."""
    edges, counts = by_sector(radar)
    usual = float(np.median(counts))
    if len(counts) < 5 or usual < ENOUGH:
        return None
    dead, alive = counts < DEAD * usual, counts > ALIVE * usual
    begin = 0
    best: tuple[int, int] | None = None
    while begin < len(counts):
        end = begin
        while end < len(counts) and dead[end]:
            end += 1
        if end - begin >= LEAST_BINS:
            between = begin > 0 and end < len(counts)
            mirrored = alive[::-1][begin:end].all()
            if (between or mirrored) and (best is None or end - begin > best[1] - best[0]):
                best = begin, end
        begin = max(end, begin + 1)
    return None if best is None else (float(edges[best[0]]), float(edges[best[1]]))


def blind(radars: Sequence[RadarTrack]) -> list[tuple[int, float]]:
    """Which radars see next to nothing, with their share of what the others see; or say themselves that they are covered."""
    mean = np.array([len(radar.range) / max(len(radar), 1) for radar in radars])
    found = []
    for n, radar in enumerate(radars):
        others = np.delete(mean, n)[[len(other) > 0 for k, other in enumerate(radars) if k != n]]
        usual = float(np.median(others)) if len(others) else 0.0
        says = len(radar) > 0 and float(np.mean(radar.blockage >= BLIND)) > OFTEN
        if len(radar) > 20 and (says or (usual >= OTHERS and mean[n] < FEW * usual)):
            found.append((n, float(mean[n] / usual) if usual else 0.0))
    return found


def outside(radar: RadarTrack) -> tuple[float, float]:
    """Share of the detections outside the field of view, and the half-width (rad) that would hold nearly all."""
    if len(radar.azimuth) < 100:
        return 0.0, radar.mount.half_fov
    off = np.abs(radar.azimuth)
    return float(np.mean(off > radar.mount.half_fov + BEYOND)), float(np.percentile(off, 99.5))


def lost_scans(steps: Floats) -> float:
    """Share of the scans that did not come, by the s between those that did."""
    if len(steps) < 9:
        return 0.0
    usual = float(np.median(steps))
    if usual <= 0:  # times that stand still
        return 0.0
    missing = np.maximum(np.round(steps / usual) - 1, 0).sum()
    return float(missing / (missing + len(steps) + 1))
