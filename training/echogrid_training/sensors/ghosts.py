"""Reflections that a wall mirrors: they appear behind it, at the image of what reflects, and move as the image does.

The signal goes by the wall there and back, so the image of something that stands has the range rate of something that stands: no filter
by range rate removes it.
"""

from __future__ import annotations

import numpy as np

from echogrid.core.messages import Floats
from echogrid_training.sensors.scatterers import Scatterers
from echogrid_training.sensors.surfaces import Flats
from echogrid_training.sensors.visibility import Indices, losses, nearest_points

MIRRORS = 4  # nearest ones that are looked at
REACH = 25.0  # m, to a mirror
FAINTER = (6.0, 15.0)  # dB, what mirroring costs
CLEAR = 3.0  # dB of loss on the way to a mirror that still count as free


def ghosts(rows: Scatterers, share: float, flats: Flats, near: Indices, barriers: tuple[Floats, Floats], origin: Floats) -> Scatterers:
    """The images of the `share` of the scatterers that are mirrored at all, as far as the radar at `origin` sees them in a mirror.

    `near`: the flats to look at; `barriers`: segments (S, 2, 2) and their losses (S,) in dB.
    """
    sources = rows[rows["luck"] < share]
    mirrors = near[flats.mirrors[near]]
    gap = nearest_points(flats.segments[mirrors], origin) - origin
    distance = np.hypot(gap[:, 0], gap[:, 1])
    nearest = np.argsort(distance, kind="stable")[:MIRRORS]
    mirrors = mirrors[nearest[distance[nearest] < REACH]]
    if not len(sources) or not len(mirrors):
        return rows[:0]

    which, source = (index.ravel() for index in np.meshgrid(np.arange(len(mirrors)), np.arange(len(sources)), indexing="ij"))
    images = sources[source]
    start, end = flats.segments[mirrors[which], 0], flats.segments[mirrors[which], 1]
    along = (end - start) / np.hypot(*(end - start).T)[:, None]
    normal = np.stack((along[:, 1], -along[:, 0]), axis=-1)
    before = ((origin - start) * normal).sum(axis=1)  # m, of the radar in front of the mirror, with sign
    depth = (images["x"] - start[:, 0]) * normal[:, 0] + (images["y"] - start[:, 1]) * normal[:, 1]
    moving = images["vx"] * normal[:, 0] + images["vy"] * normal[:, 1]
    images["x"] -= 2 * depth * normal[:, 0]
    images["y"] -= 2 * depth * normal[:, 1]
    images["vx"] -= 2 * moving * normal[:, 0]
    images["vy"] -= 2 * moving * normal[:, 1]
    images["into_x"] = images["into_y"] = 0.0  # what is mirrored is no body
    images["facing"] = 2 * np.arctan2(along[:, 1], along[:, 0]) - images["facing"]
    images["rcs"] -= FAINTER[0] + (FAINTER[1] - FAINTER[0]) * images["luck"] / share

    image = np.stack((images["x"], images["y"]), axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        seen_at = origin + (before / (before + depth))[:, None] * (image - origin)
    on_mirror = ((seen_at - start) * along).sum(axis=1)
    length = ((end - start) * along).sum(axis=1)
    real = np.flatnonzero((before * depth > 0) & (np.abs(depth) > 0.5) & (on_mirror > 0) & (on_mirror < length))
    free = losses(*barriers, origin, seen_at[real]) < CLEAR
    return images[real[free]]
