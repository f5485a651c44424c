"""What stands in and around open areas: courts between houses, car parks, the level of a multi-storey car park."""

from __future__ import annotations

import math

import numpy as np
import shapely

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.streets.network import Kind, Network, Parking
from echogrid_training.streets.shapes import box, disc, frame_at, length, offset
from echogrid_training.streets.style import Style
from echogrid_training.towns.lots import tree
from echogrid_training.towns.parking import BAY, PILLARS, parked, stretch
from echogrid_training.towns.piece import Piece, sheet, solid
from echogrid_training.towns.town import Material


def edge(outline: Floats, ways: shapely.Geometry, material: Material, top: float) -> list[Piece]:
    """Along an area's outline (N, 2), open where ways lead in or out."""
    ring = shapely.difference(shapely.linearrings(outline), ways)
    return [Piece(material, part, top) for part in shapely.get_parts(shapely.line_merge(ring)) if part.length > 0.5]


def court(outline: Floats, ways: shapely.Geometry, style: Style, rng: np.random.Generator) -> list[Piece]:
    """Garages and walls about it, cars, bins and a tree within."""
    pieces = edge(outline, ways, Material.WALL, style.wall + 1.0)
    for corner in range(len(outline)):
        side = frame_at(np.array((outline[corner], outline[(corner + 1) % len(outline)])), 0.0)
        long = float(np.hypot(*(outline[(corner + 1) % len(outline)] - outline[corner])))
        if rng.random() < 0.5:  # nose to the wall
            for x in np.arange(3.0, long - 3.0, 2.7):
                if rng.random() < style.parked:
                    pieces.append(parked(side @ SE2(x, 2.9 + rng.normal(0, 0.2), -math.pi / 2 + rng.normal(0, style.skew)), rng, 4.8))
        elif rng.random() < 0.6:
            for x in rng.uniform(1.0, long - 1.0, 3):
                pieces.append(solid(Material.WALL, box(side @ SE2(x, 0.6, rng.normal(0, 0.1)), 1.2, 0.8), 1.3, whole=True))
    x, y = (outline.mean(axis=0) + rng.normal(0, 2.5, 2)).tolist()
    return pieces + (tree(SE2(x, y, 0.0), rng) if rng.random() < 0.6 else [])


def car_park(outline: Floats, ways: shapely.Geometry, network: Network, style: Style, rng: np.random.Generator) -> list[Piece]:
    """A hedge, fence or wall about it, lamp posts and trees between the rows of bays."""
    material = (Material.HEDGE, Material.FENCE, Material.WALL)[int(rng.integers(3))]
    pieces = edge(outline, ways, material, 1.1)
    if material is Material.HEDGE:
        pieces = [Piece(material, shapely.buffer(piece.shape, 0.4, cap_style="flat"), piece.top) for piece in pieces]
    for street in network.streets:
        if street.kind is not Kind.AISLE or street.left.parking is Parking.NONE:
            continue
        between = offset(street.line, street.width / 2 + street.left.parking.value + 0.35)
        for place in np.arange(4.0, length(between), 3 * BAY):
            here = frame_at(between, place)
            if rng.random() < 0.35:
                pieces += tree(here, rng, small=True)
            elif rng.random() < 0.4:
                pieces.append(solid(Material.POLE, disc(here.x, here.y, 0.1, 6), 6.0, whole=True))
    return pieces


def storey(outline: Floats, ways: shapely.Geometry, network: Network, rng: np.random.Generator) -> list[Piece]:
    """One level of a multi-storey car park: parapets or walls, pillars between the bays, a ramp, beams and the ceiling's edge overhead."""
    low = rng.uniform(2.15, 2.5)
    pieces = edge(outline, ways, Material.WALL, low if rng.random() < 0.5 else 1.1)
    pieces.append(solid(Material.OVERHEAD, outline, low + 0.8, low))
    size = rng.uniform(0.35, 0.6)
    for street in network.streets:
        if street.kind is not Kind.AISLE or street.left.parking is Parking.NONE:
            continue
        begin, end = stretch(network, street)
        places = np.arange(begin, end, PILLARS)
        for across, sign in ((street.left, 1.0), (street.right, -1.0)):
            inner = offset(street.line, sign * (street.width / 2 + 0.9))
            outer = offset(street.line, sign * (street.width / 2 + across.parking.value + 0.2))
            for place in places if sign < 0 else length(street.line) - places:  # as the bays are counted, in the direction of travel
                for line in (inner, outer):
                    pieces.append(solid(Material.WALL, box(frame_at(line, place), size, size), low, whole=True))
        for place in places:
            here = frame_at(street.line, place)
            beam = here.apply(np.array(((0.0, -8.2), (0.0, 8.2))))
            pieces.append(sheet(Material.OVERHEAD, beam, low, low - 0.35))
            if rng.random() < 0.5:  # a sprinkler pipe, a duct, a row of lamps
                pipe = here.apply(np.array(((0.0, 2.0), (PILLARS, 2.0))))
                pieces.append(sheet(Material.OVERHEAD, pipe, low - 0.1, low - 0.3))
    return pieces
