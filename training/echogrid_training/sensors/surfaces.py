"""What hides and what mirrors: the sides of a town's things that a radar's signal is lost at, and the flat ones that shine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats
from echogrid_training.sensors.scatterers import RADAR_HEIGHT, Scatterers, points, sides_of
from echogrid_training.towns.town import Material, Thing

LOSS = {  # dB, both ways, of a signal that crosses one side of a thing
    Material.BUILDING: 200.0,
    Material.WALL: 200.0,
    Material.CAR: 9.0,  # over and under it
    Material.POLE: 3.0,
    Material.TREE: 6.0,
    Material.HEDGE: 6.0,
    Material.FENCE: 1.5,
    Material.GUARD_RAIL: 5.0,
    Material.BARRIER: 3.0,
    Material.PEDESTRIAN: 2.0,
    Material.CYCLIST: 2.0,
}


@dataclass(frozen=True, slots=True, eq=False)
class Flats:
    """Plane surfaces: where a radar stands before one, its foot point shines, and it mirrors what stands there too."""

    segments: Floats  # (F, 2, 2) m
    shine: Scatterers  # (F,) what the foot point is like; its place and direction depend on the sensor
    mirrors: NDArray[np.bool_]  # (F,) large enough for a ghost


def flats(things: Sequence[Thing], rng: np.random.Generator) -> Flats:
    """The plane surfaces of buildings, walls and guard rails that are longer than 1.5 m."""
    pieces = []
    for material, rcs in ((Material.BUILDING, 8.0), (Material.WALL, 4.0), (Material.GUARD_RAIL, 4.0)):
        sides = sides_of(thing for thing in things if thing.material is material and thing.top > RADAR_HEIGHT > thing.bottom)
        long = sides.lengths > 1.5
        segments = sides.segments[long]
        count = len(segments)
        shine = points(
            segments[:, 0], rng, rcs=rng.normal(rcs, 4.0, count), facing=sides.normals[long], width=np.radians(rng.uniform(3.0, 8.0, count))
        )
        pieces.append((segments, shine, sides.lengths[long] > 3.0))
    segments, shine, mirrors = (np.concatenate(column) for column in zip(*pieces, strict=True))
    return Flats(segments, shine, mirrors)


def barriers(things: Sequence[Thing]) -> tuple[Floats, Floats]:
    """What hides things from a radar: segments (S, 2, 2) m, and the loss (S,) in dB of a signal that goes through each."""
    hiding = [thing for thing in things if thing.bottom < RADAR_HEIGHT < thing.top and LOSS.get(thing.material, 0.0) > 0.0]
    pieces = [(thing.segments(), LOSS[thing.material]) for thing in hiding]
    segments = np.concatenate([np.zeros((0, 2, 2)), *(segments for segments, _ in pieces)])
    return segments, np.concatenate([np.zeros(0), *(np.full(len(segments), loss) for segments, loss in pieces)])
