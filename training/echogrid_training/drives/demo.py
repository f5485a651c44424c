"""The demonstration drives: one through a town of the test family, which the service ships, and one through a small plane scene."""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.drives.simulate import simulate
from echogrid_training.driving.path import Leg, Path
from echogrid_training.recording import Recording, Track, untracked
from echogrid_training.sensors.episode import paper_like
from echogrid_training.truth.ground_truth import TruthMap
from echogrid_training.worlds.layout import make_town
from echogrid_training.worlds.scene import Box, Mover, Scene, pole

DEMO_TOWN, DEMO_SECONDS = 16, 75.0
TURN_RATE, RAMP = 0.5, 0.6  # rad/s; s, in which it is reached
CORNER = 119.0  # m, where the car's way turns from along x to along y
HOUSES_RIGHT, HOUSES_LEFT = -6.5, 10.0  # m from the lane of the car, which keeps to the right
KERB_RIGHT, KERB_LEFT = -2.9, 6.4  # m, where the parked cars' middles are
ONCOMING = 3.5  # m, the other lane


def demo_path() -> Path:
    """40 s: it stands for 1 s, drives at 8 m/s, stands for 2 s before the crossing, turns left and drives at 9 m/s."""
    turn = Leg(math.pi / 2 / TURN_RATE - RAMP, 5.0, TURN_RATE)  # with its ramps it makes 90°
    first = (Leg(1.0, 0.0), Leg(3.0, 8.0), Leg(9.0, 8.0), Leg(4.0, 0.0), Leg(2.0, 0.0))
    return Path((*first, Leg(3.0, 5.0), Leg(RAMP, 5.0, TURN_RATE), turn, Leg(RAMP, 5.0), Leg(3.0, 9.0), Leg(9.0, 9.0), Leg(2.0, 5.0)))


def demo_scene() -> Scene:
    """Two streets that cross, with houses, parked cars and lamp posts, oncoming traffic, and a car that crosses while this one waits."""
    rng = np.random.default_rng(5)
    along_x, along_y = SE2(CORNER, 0.0, 0.0), SE2(CORNER, 0.0, math.pi / 2)  # the car's lane in each street, from the crossing on
    walls: list[Floats] = []
    standing: list[Box] = []
    for street, stretches in (
        (along_x, ((-150.0, -HOUSES_LEFT), (-HOUSES_RIGHT, 60.0))),
        (along_y, ((-60.0, HOUSES_RIGHT), (HOUSES_LEFT, 160.0))),
    ):
        for first, last in stretches:
            walls += [*_houses(rng, street, first, last, HOUSES_RIGHT), *_houses(rng, street, first, last, HOUSES_LEFT)]
            for kerb, direction in ((KERB_RIGHT, 0.0), (KERB_LEFT, math.pi)):
                standing += _parked(rng, street, first + 6.0, last - 6.0, kerb, direction)
    movers = (
        Mover(along_x @ SE2(-9.0, ONCOMING, math.pi), 8.0),
        Mover(along_y @ SE2(-144.0, 0.0, 0.0), 8.0),
        Mover(along_y @ SE2(300.0, ONCOMING, math.pi), 8.0),
    )
    return Scene(np.concatenate(walls), standing, movers)


def _houses(rng: np.random.Generator, world_from_street: SE2, first: float, last: float, front: float) -> list[Floats]:
    """Fronts and side walls (3, 2, 2) of houses from `first` to `last` m along the street, some set back, some with a gap between."""
    houses = []
    while first < last - 4.0:
        end = min(first + rng.uniform(8.0, 15.0), last)
        near = front + math.copysign(rng.uniform(0.0, 1.0), front)
        far = front + math.copysign(6.0, front)
        outline = world_from_street.apply(np.array(((first, far), (first, near), (end, near), (end, far))))
        houses.append(np.stack((outline[:-1], outline[1:]), axis=1))
        first = end + rng.choice((0.0, 2.5))
    return houses


def _parked(rng: np.random.Generator, world_from_street: SE2, first: float, last: float, kerb: float, direction: float) -> list[Box]:
    """Cars at the kerb from `first` to `last` m along the street, a third of the places free, and lamp posts behind every fourth place."""
    boxes = []
    for place, at in enumerate(np.arange(first, last, 6.0).tolist()):
        if rng.random() < 0.67:
            crooked = SE2(at + rng.normal(0.0, 0.3), kerb + rng.normal(0.0, 0.1), direction + rng.normal(0.0, 0.02))
            boxes.append(Box(world_from_street @ crooked, rng.uniform(3.8, 4.8), rng.uniform(1.7, 1.9)))
        if place % 4 == 0:
            lamp = world_from_street @ SE2(at + 3.0, kerb + math.copysign(1.6, kerb), 0.0)
            boxes.append(pole(lamp.x, lamp.y))
    return boxes


def town_drive(track: Track = untracked) -> tuple[Recording, TruthMap]:
    """The drive that the service ships: 75 s through a town of the test family, with the paper's kind of sensors."""
    return simulate(make_town("test", DEMO_TOWN, DEMO_SECONDS), paper_like(DEMO_TOWN), track)
