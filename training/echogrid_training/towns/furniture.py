"""What stands on pavements and over streets: kerbs, lamp posts, trees in rows, signs, bollards, guard rails, shelters, bridges."""

from __future__ import annotations

import math

import numpy as np
import shapely

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.streets.network import Kind, Network, Parking, Side, Street
from echogrid_training.streets.shapes import box, disc, frame_at, length, offset, part, rectangle
from echogrid_training.streets.style import Style
from echogrid_training.towns.lots import tree
from echogrid_training.towns.parking import stretch
from echogrid_training.towns.piece import Piece, sheet, solid
from echogrid_training.towns.town import Material

KERB = 0.12  # m high


def kerbs(ground: shapely.Geometry) -> list[Piece]:
    """Round all that cars drive and park on."""
    rings = [ring for polygon in shapely.get_parts(ground) for ring in (polygon.exterior, *polygon.interiors)]
    return [Piece(Material.KERB, shapely.simplify(ring, 0.1), KERB) for ring in rings if ring.length > 4.0]


def along_street(network: Network, street: Street, style: Style, rng: np.random.Generator) -> list[Piece]:
    """On the pavements of both sides of a street."""
    pieces: list[Piece] = []
    begin, end = stretch(network, street)
    lit = rng.random() < 0.5
    for forward in (True, False):
        side = street.side(forward, right=True)
        line = offset(street.towards(forward), -(street.width / 2 + side.parking.value))
        first, last = (begin, end) if forward else (length(street.line) - end, length(street.line) - begin)
        if street.kind is Kind.STREET and side.pavement > 1.2 and last - first > 8.0:
            pieces += _pavement(line, first, min(last, length(line)), side, lit == forward, style, rng)
    return pieces


def _pavement(line: Floats, first: float, last: float, side: Side, lit: bool, style: Style, rng: np.random.Generator) -> list[Piece]:
    """To the right of the line (N, 2) that the pavement begins at."""
    pieces: list[Piece] = []
    pavement = side.pavement
    kerb = 0.45
    if lit:
        for place in np.arange(first + rng.uniform(0.0, 8.0), last, style.lamps):
            pieces.append(_post(frame_at(line, place + rng.normal(0, 0.5)), kerb, rng.uniform(0.07, 0.12), rng.uniform(5.0, 9.0)))
    if pavement > 1.8 and rng.random() < 0.4:
        for place in np.arange(first + rng.uniform(2.0, 6.0), last - 1.0, style.trees):
            if rng.random() < 0.9:
                pieces += tree(frame_at(line, place + rng.normal(0, 0.4)) @ SE2(0.0, -0.75 + rng.normal(0, 0.05), 0.0), rng)
    elif rng.random() < 0.15:  # against parking on the pavement
        start = rng.uniform(first, max(first, last - 12.0))
        for place in np.arange(start, min(start + rng.uniform(9.0, 25.0), last), 1.6):
            pieces.append(_post(frame_at(line, place), kerb, 0.08, 0.95))
    elif rng.random() < 0.12 and side.parking is Parking.NONE:
        span = part(offset(line, -0.35), first + 2.0, max(first + 4.0, last - 2.0))
        pieces.append(sheet(Material.GUARD_RAIL if rng.random() < 0.5 else Material.FENCE, span, rng.uniform(0.75, 1.1)))
    for place in rng.uniform(first, last, int(rng.integers(1, 4))):  # signs
        pieces.append(_post(frame_at(line, place), kerb - 0.1, 0.04, rng.uniform(2.2, 3.2)))
    if rng.random() < 0.3:  # a switch cabinet, a bin, a letter box
        here = frame_at(line, rng.uniform(first, last)) @ SE2(0.0, -(pavement - 0.35), rng.normal(0, 0.05))
        pieces.append(solid(Material.WALL, box(here, rng.uniform(0.5, 1.3), rng.uniform(0.35, 0.5)), rng.uniform(0.9, 1.5), whole=True))
    if pavement > 2.4 and side.parking is Parking.NONE and rng.random() < 0.12:  # a bus shelter
        here = frame_at(line, rng.uniform(first, last)) @ SE2(0.0, -0.7, 0.0)
        outline = here.apply(np.array(((-1.9, 0.0), (-1.9, -1.1), (1.9, -1.1), (1.9, 0.0))))
        pieces.append(sheet(Material.WALL, outline, 2.3))
    return pieces


def _post(here: SE2, right: float, radius: float, top: float) -> Piece:
    place = here @ SE2(0.0, -right, 0.0)
    return solid(Material.POLE, disc(place.x, place.y, radius, 6), top, whole=True)


def at_crossings(network: Network, rng: np.random.Generator) -> list[Piece]:
    """Signals or signs on the corners where streets meet."""
    pieces = []
    for index, street in enumerate(network.streets):
        for forward in (True, False):
            node = street.ends[1 if forward else 0]
            if street.kind is not Kind.STREET or network.meeting[node] < 3 or (index + node) % 3 == 0:
                continue
            here = frame_at(street.towards(forward), max(0.0, length(street.line) - network.reach[node] + rng.normal(0, 0.4)))
            pieces.append(_post(here, street.width / 2 + rng.uniform(0.4, 0.8), rng.uniform(0.04, 0.1), rng.uniform(2.4, 4.0)))
    return pieces


def island(x: float, y: float, radius: float, rng: np.random.Generator) -> list[Piece]:
    """In the middle of a roundabout: lawn, trees, a hedge, a wall or a monument."""
    pieces = []
    kind = rng.random()
    if kind < 0.4:
        for turn in np.arange(rng.integers(3, 7)) * 1.1:
            pieces += tree(SE2(x, y, turn) @ SE2(rng.uniform(0.3, 0.75) * radius, 0.0, 0.0), rng)
    elif kind < 0.7:
        pieces.append(solid(Material.HEDGE, disc(x, y, 0.55 * radius, 14), 1.1))
    else:
        pieces.append(solid(Material.WALL, disc(x, y, rng.uniform(0.2, 0.5) * radius, 10), rng.uniform(0.6, 2.5)))
    for turn in rng.uniform(0, math.tau, 3):
        place = SE2(x, y, turn) @ SE2(radius - 0.9, 0.0, 0.0)
        pieces.append(solid(Material.POLE, disc(place.x, place.y, 0.05, 6), 2.4, whole=True))
    return pieces


def bridge(street: Street, rng: np.random.Generator) -> tuple[list[Piece], Floats]:
    """A railway across the street: abutments, pillars perhaps, a deck overhead; and the outline that buildings keep clear of."""
    place = length(street.line) * rng.uniform(0.4, 0.6)
    wide, turn = rng.uniform(7.0, 16.0), rng.normal(0.0, 0.15)
    here = frame_at(street.line, place) @ SE2(0.0, 0.0, turn)
    pieces = []
    left, right = (street.width / 2 + side.width + 0.2 for side in (street.left, street.right))
    for sign, reach in ((1.0, left), (-1.0, -right)):
        abutment = here @ SE2(-wide / 2, reach + sign * 0.75, 0.0)
        pieces.append(solid(Material.WALL, rectangle(abutment, wide, 1.5), 4.6))
        for end in (-1.0, 1.0):  # wing walls hold the embankment
            corner = here @ SE2(end * wide / 2, reach + sign * 0.2, 0.0)
            wing = corner.apply(np.array(((0.0, 0.0), (end * rng.uniform(1.5, 3.0), sign * rng.uniform(7.0, 12.0)))))
            pieces.append(sheet(Material.WALL, wing, rng.uniform(2.0, 4.0)))
    if rng.random() < 0.5:
        for across in (street.width / 2 + 0.5, -street.width / 2 - 0.5):
            for x in np.arange(-wide / 2 + 1.0, wide / 2, 4.0):
                pieces.append(solid(Material.WALL, box(here @ SE2(x, across, 0.0), 0.5, 0.5), 4.6, whole=True))
    deck = (here @ SE2(-wide / 2, 0.0, 0.0)).apply(
        np.array(((0.0, -right - 8.0), (wide, -right - 8.0), (wide, left + 8.0), (0.0, left + 8.0)))
    )
    pieces.append(solid(Material.OVERHEAD, deck, 6.2, rng.uniform(3.8, 4.6)))
    grown = (here @ SE2(-wide / 2 - 1.0, 0.0, 0.0)).apply(
        np.array(((0.0, -right - 14.0), (wide + 2.0, -right - 14.0), (wide + 2.0, left + 14.0), (0.0, left + 14.0)))
    )
    return pieces, grown
