"""How high a lidar's returns lie above the ground: by the mount's height alone, or above a street that rises and falls."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from echogrid.core.messages import Floats

Heights = Callable[[Floats, Floats], Floats]  # points (N, 3) m in base, place of the lidar (3,) -> (N,) m above the ground

SECTORS = 90  # of bearing, in which the ground is followed outwards
RING, FARTHEST = 1.0, 50.0  # m: steps of the way out, and how far it goes
STEEPEST = 0.25  # of a street
STEP, BEND, MOST = 0.15, 0.01, 0.5  # m off its slope at once: kerbs; how much more over a way in m, m / m²; and at most, m
FEW = 3  # returns of a ring, of which the lowest but one is taken for the ground: one below it is a mirror image
BEFORE = 5.0  # m of ground by which its slope is told
KNOWN = 2.5  # m around the car that is level with its wheels
NEAREST, SOFT = 16, 4.0  # ground that a plane goes through, and how much is asked of it to be steep


def flat(points: Floats, _: Floats) -> Floats:
    """The ground is level: what the wheels stand on, as far as the lidar sees."""
    return points[:, 2]


def followed(points: Floats, lidar: Floats) -> Floats:
    """The ground is followed outwards from the car, sector by sector, by the lowest returns: what rises faster than a street is a thing.

    Where no ground comes back, behind things and beyond them, it lies on the plane of the ground nearest to there.
    """
    away = points[:, :2] - lidar[:2]
    distance = np.hypot(away[:, 0], away[:, 1])
    turn = np.arctan2(away[:, 1], away[:, 0]) / (2 * np.pi) + 0.5
    sector = np.floor(turn * SECTORS).astype(np.intp) % SECTORS
    rings = round(FARTHEST / RING)
    ring = np.minimum((distance / RING).astype(np.intp), rings - 1)
    at, height = _walked(_lowest(sector * rings + ring, points[:, 2], distance, SECTORS * rings))
    return points[:, 2] - _read(_filled(at, height), turn * SECTORS, distance)


def _lowest(cell: NDArray[np.intp], z: Floats, distance: Floats, cells: int) -> Floats:
    """(SECTORS, rings, 2) m: height and distance of the lowest return of each ring but one, NaN where there are less than FEW."""
    order = np.lexsort((z, cell))
    first = np.searchsorted(cell[order], np.arange(cells))
    count = np.append(first[1:], len(cell)) - first
    some = count >= FEW
    out = np.full((cells, 2), np.nan)
    chosen = order[first[some] + 1]
    out[some] = np.stack((z[chosen], distance[chosen]), axis=-1)
    return out.reshape(SECTORS, -1, 2)


def _walked(lowest: Floats) -> tuple[Floats, Floats]:
    """(SECTORS, rings + 1) m each: distance and height of what is taken for ground, from the car on; NaN where nothing is."""
    sectors, rings = lowest.shape[:2]
    at, height = np.full((sectors, rings + 1), np.nan), np.full((sectors, rings + 1), np.nan)
    at[:, 0], height[:, 0] = KNOWN, 0.0
    last_at, last, slope = np.full(sectors, KNOWN), np.zeros(sectors), np.zeros(sectors)
    for ring in range(rings):
        z, where = lowest[:, ring, 0], lowest[:, ring, 1]
        step = where - last_at
        bent = np.minimum(STEP + BEND * step**2, MOST)
        fits = (step > 0) & (np.abs(z - last - slope * step) < bent) & (np.abs(z - last) < STEP + STEEPEST * step)
        at[fits, ring + 1], height[fits, ring + 1] = where[fits], z[fits]
        last_at, last = np.where(fits, where, last_at), np.where(fits, z, last)
        slope = np.where(fits, _slope(at[:, : ring + 2], height[:, : ring + 2], last_at), slope)
    return at, height


def _slope(at: Floats, height: Floats, now: Floats) -> Floats:
    """(SECTORS,) by a line through the ground of the last BEFORE m; 0 where there is one place only."""
    near = np.isfinite(at) & (at >= now[:, None] - BEFORE)
    count = np.maximum(near.sum(axis=1), 1)
    x, z = np.where(near, at, 0.0), np.where(near, height, 0.0)
    mean_x, mean_z = x.sum(axis=1) / count, z.sum(axis=1) / count
    off = np.where(near, at - mean_x[:, None], 0.0)
    spread = (off**2).sum(axis=1)
    slope = np.divide((off * np.where(near, height - mean_z[:, None], 0.0)).sum(axis=1), spread, out=np.zeros(len(now)), where=spread > 0.1)
    steep: Floats = np.clip(slope, -STEEPEST, STEEPEST)
    return steep


def _filled(at: Floats, height: Floats) -> Floats:
    """(SECTORS, rings + 1) m: the ground at the middle of each sector and the edges of rings, by planes through the nearest ground."""
    bearing = (np.arange(SECTORS) + 0.5) * (2 * np.pi / SECTORS)
    ahead = np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)
    known = np.isfinite(at)
    ground = (at[..., None] * ahead[:, None])[known]  # (G, 2)
    edges = (np.arange(at.shape[1]) * RING)[:, None] * ahead[:, None]  # (SECTORS, rings + 1, 2)
    distance, nearest = cKDTree(ground).query(edges.reshape(-1, 2), NEAREST)
    weight = 1.0 / (distance + RING)
    off, z = ground[nearest] - edges.reshape(-1, 1, 2), height[known][nearest]
    system = np.concatenate((off, np.ones((*off.shape[:2], 1))), axis=-1)  # slopes along x and y, height at the edge
    normal = np.einsum("nki,nk,nkj->nij", system, weight, system) + np.diag((SOFT, SOFT, 0.0))
    found = np.linalg.solve(normal, np.einsum("nki,nk,nk->ni", system, weight, z)[..., None])
    heights: Floats = found[:, 2, 0].reshape(at.shape)
    return heights


def _read(profile: Floats, sector: Floats, distance: Floats) -> Floats:
    """(N,) m, between the edges of rings and the middles of sectors, which are counted from 0 in fractions."""
    place, turn = np.minimum(distance / RING, profile.shape[1] - 1.001), sector - 0.5
    ring, left = place.astype(np.intp), np.floor(turn).astype(np.intp)
    out, aside = place - ring, turn - left
    near, far = ((1 - out) * profile[one, ring] + out * profile[one, ring + 1] for one in (left % SECTORS, (left + 1) % SECTORS))
    ground: Floats = (1 - aside) * near + aside * far
    return ground


GROUNDS: dict[str, Heights] = {"flat": flat, "followed": followed}
