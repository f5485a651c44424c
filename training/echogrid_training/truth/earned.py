"""What radars can have earned of a true patch: the cells that some look had in free sight, and those beside a detection.

A network that is taught the lidar's truth of places which no radar looked at learns to call them free by habit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from echogrid.core.evidence.history import Looks, Surroundings
from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.messages import Floats

LOOKS = 32  # of the history that are tried, evenly chosen
BEARINGS = 720
BESIDE = 2  # cells from a detection that count as looked at, whatever stands before them


def earned(truth: Image, around: Surroundings, spec: GridSpec) -> NDArray[np.bool_]:
    """(H, W): whether the radars can tell of each cell of a true patch, log-odds (H, W), both in base now."""
    occupied = truth > 0
    cells = spec.centres()
    blocks = cells.reshape(spec.cells // 2, 2, spec.cells // 2, 2, 2).mean(axis=(1, 3))
    seen = in_sight(np.concatenate((blocks.reshape(-1, 2), cells[occupied])), cells[occupied], around.looks, spec.cell)
    out = np.repeat(np.repeat(seen[: blocks[..., 0].size].reshape(blocks.shape[:2]), 2, axis=0), 2, axis=1)
    out[occupied] = seen[blocks[..., 0].size :]
    detected = np.zeros(spec.cells**2, dtype=bool)
    where = spec.locate(around.past.points)
    detected[where[where >= 0]] = True
    beside: NDArray[np.bool_] = binary_dilation(detected.reshape(out.shape), np.ones((3, 3), dtype=bool), BESIDE)
    return out | beside


def in_sight(places: Floats, standing: Floats, looks: Looks, cell: float) -> NDArray[np.bool_]:
    """(N,) whether some of the looks had each place (N, 2) m in view, with none of the cells about `standing` (M, 2) before it.

    A place up to a cell behind what hides is still seen: it is the surface itself.
    """
    seen = np.zeros(len(places), dtype=bool)
    for index in np.unique(np.linspace(0, len(looks.place) - 1, min(LOOKS, len(looks.place))).astype(np.intp)):
        x, y, yaw = looks.place[index]
        first = _first(standing - (x, y), cell)
        left = np.flatnonzero(~seen)
        dx, dy = places[left, 0] - x, places[left, 1] - y
        distance, bearing = np.hypot(dx, dy), np.arctan2(dy, dx)
        off = np.abs((bearing - yaw + np.pi) % (2 * np.pi) - np.pi)
        ray = np.floor(bearing * (BEARINGS / (2 * np.pi))).astype(np.intp) % BEARINGS
        inside = (off <= looks.half_fov[index]) & (distance <= looks.max_range[index])
        seen[left[inside & (distance <= first[ray] + cell)]] = True
    return seen


def _first(standing: Floats, cell: float) -> Floats:
    """(BEARINGS,) m from (0, 0) to the nearest of the cells about `standing` (M, 2) in each direction, inf where there is none."""
    first = np.full(BEARINGS, np.inf)
    distance = np.hypot(standing[:, 0], standing[:, 1])
    middle = np.arctan2(standing[:, 1], standing[:, 0]) * (BEARINGS / (2 * np.pi))
    half = np.minimum(0.5 * cell / np.maximum(distance, 0.5 * cell), 0.8) * (
        BEARINGS / (2 * np.pi)
    )  # rays that a cell covers, to each side
    for step in range(-int(np.ceil(half.max(initial=0.0))), int(np.ceil(half.max(initial=0.0))) + 1):
        covers = np.abs(step) <= half + 0.5
        np.minimum.at(first, np.floor(middle[covers] + step).astype(np.intp) % BEARINGS, distance[covers])
    return first
