"""Parked cars: along kerbs, across and at an angle in bays, never quite straight, never quite in the middle."""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.motion.se2 import SE2
from echogrid_training.streets.network import Network, Parking, Street
from echogrid_training.streets.shapes import body, frame_at, length, offset
from echogrid_training.streets.style import Style
from echogrid_training.towns.piece import Piece, solid
from echogrid_training.towns.town import Material

BAY = 2.55  # m wide
PILLARS = 3 * BAY + 0.7  # m from pillar to pillar in a multi-storey car park: three bays between two


def vehicle(rng: np.random.Generator) -> tuple[float, float, float]:
    """Length, width and height, m, of something that parks: mostly cars, some vans."""
    if rng.random() < 0.1:
        return rng.uniform(5.0, 6.2), rng.uniform(1.95, 2.1), rng.uniform(2.0, 2.7)
    long = rng.normal(4.35, 0.35)
    return float(np.clip(long, 3.5, 5.0)), rng.uniform(1.65, 1.92), rng.uniform(1.4, 1.8)


def parked(pose: SE2, rng: np.random.Generator, most: float = 9.0) -> Piece:
    """A car whose centre is at that pose; no longer than `most` m."""
    long, wide, high = vehicle(rng)
    return solid(Material.CAR, body(pose, min(long, most), wide), high, whole=True)


def stretch(network: Network, street: Street) -> tuple[float, float]:
    """From where to where along the street one may park: away from its ends where other streets meet it."""
    ends = []
    for node in street.ends:
        others = network.meeting[node]
        ends.append(0.5 if others == 2 else (1.0 if others < 2 else network.reach[node] + 1.5))
    return ends[0], length(street.line) - ends[1]


def beside(network: Network, street: Street, style: Style, rng: np.random.Generator) -> list[Piece]:
    """The cars on both sides of a street."""
    cars = []
    begin, end = stretch(network, street)
    for forward in (True, False):
        side = street.side(forward, right=True)
        if side.parking is Parking.NONE or end - begin < 6.0:
            continue
        kerb = offset(street.towards(forward), -street.width / 2)
        fill = float(np.clip(style.parked + rng.normal(0.0, 0.12), 0.05, 0.97))
        first, last = (begin, end) if forward else (length(street.line) - end, length(street.line) - begin)
        cars += _row(kerb, first, min(last, length(kerb)), side.parking, fill, style, rng)
    return cars


def _row(kerb: np.ndarray, first: float, last: float, parking: Parking, fill: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """Cars to the right of a kerb line from `first` to `last` m along it."""
    cars = []
    turn = {Parking.ALONG: 0.0, Parking.ANGLED: math.radians(-55.0), Parking.ACROSS: math.radians(-90.0)}[parking]
    pitch = style.pitch if parking is Parking.ALONG else BAY / abs(math.sin(turn))
    pillared = style.layout == "multi_storey" and parking is Parking.ACROSS
    noses_out = 0.0 if parking is Parking.ANGLED else 0.3
    taken = rng.random() < fill
    place = first + pitch / 2 + (0.35 if pillared else rng.uniform(0.0, 1.0))
    bays = 0
    while place < last - pitch / 2:
        if rng.random() < 0.45:  # full and empty spaces come in groups
            taken = rng.random() < fill
        if taken:
            here = frame_at(kerb, place + rng.normal(0.0, 0.02 * pitch))
            about = math.pi if parking is not Parking.ALONG and rng.random() < noses_out else 0.0
            if parking is Parking.ALONG and rng.random() < 0.04:
                about = math.pi
            skew = rng.normal(0.0, style.skew)
            deep = parking.value / 2 + rng.normal(0.0, 0.1 if parking is Parking.ALONG else 0.2)
            cars.append(parked(here @ SE2(0.0, -deep, turn + about + skew), rng, pitch - 0.4 if parking is Parking.ALONG else 5.4))
        place += pitch + (abs(rng.normal(0.0, 0.35)) if parking is Parking.ALONG else 0.0)
        bays += 1
        if pillared:
            place += PILLARS - 3 * BAY if bays % 3 == 0 else 0.0
        elif rng.random() < 0.03:  # a driveway, a tree, a hydrant
            place += rng.uniform(2.0, 4.0)
    return cars
