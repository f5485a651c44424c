"""A plain Elfes map by rays, as the reference scores draw it: the yardstick that shares nothing with the service but its poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.messages import Floats
from echogrid_training.evaluation.recorded.drive import Reflections
from echogrid_training.evaluation.recorded.scores import Rectangle

OCCUPIED, FREE, CLAMP = 0.85, -0.12, 3.5  # log-odds
SPREAD = ((-1, 0.5), (0, 1.0), (1, 0.5))  # sigmas of the bearing, and how much of OCCUPIED goes there
SIGMA = np.deg2rad(1.5)
LEAST, MARGIN = 0.5, 0.3  # m: nearer detections are not drawn; rays begin and end so far from sensor and detection

Flat = NDArray[np.int64]


def plain_elfes(scans: Sequence[Reflections], where: Rectangle) -> LogOdds:
    """(H, W) log-odds of a rectangle that all of it lies in, 0 where no ray went."""
    out = np.zeros(where.height * where.width)
    for scan in scans:
        drawn = scan.range >= LEAST
        range_, bearing = scan.range[drawn], scan.bearing[drawn]
        points, ray = along(scan.origin, bearing, range_ - MARGIN, MARGIN, where.cell)
        passed = once(where.flat(points), ray, out.size)
        np.add.at(out, passed, FREE)
        touched = [passed]
        for sigmas, share in SPREAD:
            angle = bearing + sigmas * SIGMA
            hit = where.flat(scan.origin + range_[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=-1))
            np.add.at(out, hit, OCCUPIED * share)
            touched.append(hit)
        cells = np.concatenate(touched)
        out[cells] = np.clip(out[cells], -CLAMP, CLAMP)
    return out.astype(np.float32).reshape(where.height, where.width)


def along(origin: Floats, bearing: Floats, length: Floats, first: float, step: float) -> tuple[Floats, Flat]:
    """Points (K, 2) m on rays (N,), every `step` from `first` on and before `length` (N,) m; with each its ray's number (K,)."""
    steps = np.arange(first, length.max(initial=0.0), step)
    ray, index = np.nonzero(steps < length[:, None])
    points: Floats = origin + steps[index, None] * np.stack((np.cos(bearing[ray]), np.sin(bearing[ray])), axis=-1)
    return points, ray


def once(cells: Flat, ray: Flat, size: int) -> Flat:
    """Flat cells (K,) of `size`, those that one ray has twice left out; so are those outside, -1."""
    inside = cells >= 0
    left: Flat = np.unique(ray[inside] * size + cells[inside]) % size
    return left
