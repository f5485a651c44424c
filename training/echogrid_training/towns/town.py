"""A town to drive in: standing things with outline, height and material, other traffic, and the way the ego goes.

One frame for all: the town's, x east, y north in m, yaw counter-clockwise in rad; times in s from the start of the drive.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from echogrid.core.messages import Floats


class Material(Enum):
    """What a thing is made of, as a radar and a lidar see it."""

    BUILDING = "building"  # flat, specular, with windows and corners that scatter
    WALL = "wall"  # garden walls, retaining walls: like buildings, but rough and low
    CAR = "car"  # parked or moving
    POLE = "pole"  # lamp posts, signs, bollards
    TREE = "tree"  # a trunk; its crown is overhead
    HEDGE = "hedge"  # volumetric: a radar sees some way into it
    FENCE = "fence"  # wire: partly transparent
    GUARD_RAIL = "guard_rail"  # posts every 2 or 4 m and a rail
    CONE = "cone"  # plastic: hardly seen by a radar
    BARRIER = "barrier"  # of roadworks
    BICYCLE = "bicycle"  # or motorcycle, that stands
    PLATE = "plate"  # drains, covers and rails in the ground: free in the truth, but a radar sees them
    KERB = "kerb"  # under 0.2 m: free in the truth
    OVERHEAD = "overhead"  # bridges, crowns, ceilings: above a car's roof, free in the truth, but a radar may see them
    PEDESTRIAN = "pedestrian"
    CYCLIST = "cyclist"


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """Something that stands: vertical surfaces along its outline from `bottom` to `top` m above the ground."""

    material: Material
    outline: Floats  # (N, 2) m; counter-clockwise where closed, N >= 3; else an open line, N >= 2
    closed: bool
    bottom: float = 0.0
    top: float = 3.0

    def segments(self) -> Floats:
        """(S, 2, 2) m: the outline's sides from corner to corner; outside is to the right of each side of a closed outline."""
        ends = np.roll(self.outline, -1, axis=0) if self.closed else self.outline[1:]
        return np.stack((self.outline[: len(ends)], ends), axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Where something is over time: poses of base (ego) or of the centre (movers), between them interpolated along arcs."""

    time: Floats  # (T,) s, increasing
    x: Floats  # (T,) m
    y: Floats  # (T,) m
    yaw: Floats  # (T,) rad, continuous
    speed: Floats  # (T,) m/s along yaw; negative in reverse
    yaw_rate: Floats  # (T,) rad/s


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """Other traffic: a box of `length` along its yaw, `width` and `height` m about the track's poses."""

    material: Material
    length: float
    width: float
    height: float
    track: Track


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """A centre line (N, 2) m and a width m: for drawing and for placing traffic."""

    line: Floats
    width: float


@dataclass(frozen=True, slots=True, eq=False)
class Town:
    """A place, its traffic, and one drive through it. `family` is the layout family, `seed` reproduces everything bit for bit."""

    name: str
    family: str
    seed: int
    things: tuple[Thing, ...]
    roads: tuple[Road, ...]
    movers: tuple[Mover, ...]
    ego: Track  # base, sampled at 100 Hz


def observed_by_car(material: Material) -> bool:
    """Whether a thing of this material, from the ground up, stops a car: what the truth calls occupied."""
    return material not in (Material.PLATE, Material.KERB, Material.OVERHEAD)
