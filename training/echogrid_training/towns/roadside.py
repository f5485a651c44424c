"""Small things beside and on the road: roadworks, people who stand, two-wheelers, bins, bollards, bushes, and iron in the ground."""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.streets.network import Kind, Network, Street
from echogrid_training.streets.shapes import box, disc, frame_at, length, offset
from echogrid_training.streets.style import Style
from echogrid_training.towns.parking import parked, stretch
from echogrid_training.towns.piece import Piece, solid
from echogrid_training.towns.town import Material

PER = 25.0  # m of a street's side, in which there is one of each usual kind where a town has all of them
WORKS = 0.35  # share of the sides of streets that are dug up, likewise


def along_road(network: Network, street: Street, style: Style, rng: np.random.Generator) -> list[Piece]:
    """On both sides of a street, as many as the style's `small` says."""
    pieces: list[Piece] = []
    begin, end = stretch(network, street)
    if street.kind is not Kind.STREET or end - begin < 8.0:
        return pieces
    for forward in (True, False):
        side = street.side(forward, right=True)
        line = street.towards(forward)
        first, last = (begin, end) if forward else (length(street.line) - end, length(street.line) - begin)
        edge = offset(line, -street.width / 2)
        kerb = offset(line, -(street.width / 2 + side.parking.value))
        last = min(last, length(kerb), length(edge))
        if last - first < 4.0:
            continue
        usual = style.small * (last - first) / PER
        for make in (_person, _two_wheelers, _bin, _bollards, _bush, _bush):
            for _ in range(int(rng.poisson(0.6 * usual))):
                pieces += make(frame_at(kerb, rng.uniform(first, last)), max(side.pavement, 1.0), rng)
        for _ in range(int(rng.poisson(usual))):
            here = frame_at(edge, rng.uniform(first, last)) @ SE2(0.0, rng.uniform(0.1, street.width - 0.1), 0.0)
            pieces.append(solid(Material.PLATE, disc(here.x, here.y, rng.uniform(0.1, 0.35), 6), 0.02, whole=True))
        if rng.random() < WORKS * style.small:
            pieces += works(edge, first, last, street.width, rng)
    return pieces


def works(edge: Floats, first: float, last: float, width: float, rng: np.random.Generator) -> list[Piece]:
    """A stretch along the edge of a carriageway (N, 2), to its left, closed off with cones or barriers; somebody works there perhaps."""
    pieces: list[Piece] = []
    start = rng.uniform(first, max(first, last - 12.0))
    end = min(start + rng.uniform(8.0, 45.0), last)
    closed = rng.uniform(0.4, min(3.0, 0.35 * width))  # m of the carriageway
    barriers, step = rng.random() < 0.4, rng.uniform(1.5, 5.0)
    place = start
    while place < end:
        share = min((place - start) / 6.0, (end - place) / 6.0, 1.0)  # it begins and ends at the kerb
        here = frame_at(edge, place) @ SE2(0.0, closed * max(share, 0.1) + rng.normal(0.0, 0.08), rng.normal(0.0, 0.06))
        if barriers:
            pieces.append(barrier(here, rng))
            place += rng.uniform(2.0, 2.6) if rng.random() < 0.8 else rng.uniform(3.0, 7.0)
        else:
            pieces.append(cone(here, rng))
            place += step * rng.uniform(0.8, 1.25)
    for _ in range(int(rng.integers(0, 4))):
        pieces += _person(frame_at(edge, rng.uniform(start, end)) @ SE2(0.0, rng.uniform(0.0, closed), 0.0), 0.0, rng)
    if closed > 2.2 and rng.random() < 0.5:  # a digger, a lorry, a generator
        pieces.append(parked(frame_at(edge, (start + end) / 2) @ SE2(0.0, 0.9, rng.normal(0.0, 0.05)), rng))
    return pieces


def cone(here: SE2, rng: np.random.Generator) -> Piece:
    return solid(Material.CONE, disc(here.x, here.y, rng.uniform(0.12, 0.22), 6), rng.uniform(0.5, 1.0), whole=True)


def barrier(here: SE2, rng: np.random.Generator) -> Piece:
    """Of plastic or concrete, or a grid on feet."""
    return solid(Material.BARRIER, box(here, rng.uniform(1.2, 2.2), rng.uniform(0.25, 0.65)), rng.uniform(0.8, 1.2), whole=True)


def _person(kerb: SE2, pavement: float, rng: np.random.Generator) -> list[Piece]:
    """Who waits at the kerb or stands on the pavement, seldom alone."""
    place = kerb @ SE2(0.0, -rng.uniform(-0.2, pavement), 0.0)
    some = (place @ SE2(rng.normal(0.0, 0.7), rng.normal(0.0, 0.7), 0.0) for _ in range(int(rng.integers(1, 4))))
    return [solid(Material.PEDESTRIAN, disc(one.x, one.y, rng.uniform(0.2, 0.3), 6), rng.uniform(1.5, 1.9), whole=True) for one in some]


def _two_wheelers(kerb: SE2, pavement: float, rng: np.random.Generator) -> list[Piece]:
    """Bicycles and motorcycles side by side, at the kerb on the road or on the pavement."""
    across = rng.uniform(0.3, 1.0) if rng.random() < 0.3 else -rng.uniform(0.4, pavement)
    turn, gap = math.pi / 2 * rng.uniform(0.6, 1.4), rng.uniform(0.6, 1.2)
    return [
        solid(Material.BICYCLE, box(kerb @ SE2(gap * number, across, turn), rng.uniform(1.6, 2.1), rng.uniform(0.4, 0.8)), 1.1, whole=True)
        for number in range(int(rng.integers(1, 6)))
    ]


def _bin(kerb: SE2, pavement: float, rng: np.random.Generator) -> list[Piece]:
    here = kerb @ SE2(0.0, -rng.uniform(0.3, pavement), rng.normal(0.0, 0.2))
    return [solid(Material.WALL, box(here, rng.uniform(0.4, 1.2), rng.uniform(0.4, 0.7)), rng.uniform(0.8, 1.3), whole=True)]


def _bollards(kerb: SE2, pavement: float, rng: np.random.Generator) -> list[Piece]:
    places = (kerb @ SE2(1.5 * number, -0.35, 0.0) for number in range(int(rng.integers(1, 5))))
    return [solid(Material.POLE, disc(one.x, one.y, rng.uniform(0.05, 0.12), 6), rng.uniform(0.6, 1.1), whole=True) for one in places]


def _bush(kerb: SE2, pavement: float, rng: np.random.Generator) -> list[Piece]:
    """Behind the pavement, where nothing else stands."""
    radius = rng.uniform(0.3, 1.4)
    place = kerb @ SE2(0.0, -(pavement + radius + rng.uniform(0.0, 3.0)), 0.0)
    return [solid(Material.HEDGE, disc(place.x, place.y, radius, 8), rng.uniform(0.5, 2.0), whole=True)]
