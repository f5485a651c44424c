"""What lines a street: lots of several kinds, one after the other along the back of the pavement.

A lot's frame has x along the street from the lot's start and y away from the street, 0 at the back of the pavement; m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import shapely

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.streets.shapes import box, disc, frame_at, length
from echogrid_training.streets.style import Style
from echogrid_training.towns.buildings import building
from echogrid_training.towns.parking import parked
from echogrid_training.towns.piece import Piece, sheet, solid
from echogrid_training.towns.town import Material

M = TypeVar("M", Material, Material | None)
EDGE = 0.15  # m that walls, fences and hedges stand back from the pavement


def line_front(border: Floats, begin: float, end: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """Lots to the left of a border line (N, 2) m, from `begin` to `end` m along it."""
    names, weights = zip(*style.lots, strict=True)
    shares = np.array(weights) / sum(weights)
    pieces: list[Piece] = []
    place, name = begin, str(rng.choice(names, p=shares))
    height = style.storeys * rng.uniform(0.85, 1.15)
    while place < min(end, length(border)) - 3.0:
        if rng.random() < 0.4:  # like stands next to like
            name = str(rng.choice(names, p=shares))
            height = style.storeys * rng.uniform(0.8, 1.2)
        wanted = _width(name, style, rng)
        wide = min(wanted, end - place)
        if end - place - wide < 5.0:
            wide = end - place
        if wide < 9.0 and name != "bare":  # too narrow for anything else
            name = "row"
        middle = frame_at(border, place + wide / 2)
        lot = middle @ SE2(-wide / 2, 0.0, 0.0)
        pieces += _LOTS[name](lot, wide, height, style, rng)
        place += wide
        if name == "row" and rng.random() < 0.12:  # a passage between two buildings, sometimes with a wall across
            gap = rng.uniform(1.2, 4.0)
            if rng.random() < 0.5:
                pieces.append(sheet(Material.WALL, lot.apply(np.array(((wide, 2.5), (wide + gap, 2.5)))), style.wall))
            place += gap
    return pieces


def _width(name: str, style: Style, rng: np.random.Generator) -> float:
    """Of a lot along the street, m."""
    if name == "row":
        return style.front * rng.uniform(0.8, 1.25)
    if name == "house":
        return style.front + rng.uniform(4.0, 8.0)
    widths = {
        "forecourt": (13.0, 22.0),
        "green": (10.0, 24.0),
        "yard": (10.0, 20.0),
        "hall": (24.0, 38.0),
        "colonnade": (18.0, 30.0),
        "bare": (15.0, 40.0),
    }
    return rng.uniform(*widths[name])


def _row(lot: SE2, wide: float, height: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """A building at the pavement, wall to wall with its neighbours; perhaps a front yard one can hardly stand in."""
    back = rng.choice((0.02, rng.uniform(0.05, 0.5), rng.uniform(0.9, 1.8)), p=(0.5, 0.35, 0.15))
    pieces = [building(lot @ SE2(0.0, back + 0.5, 0.0), wide, style.depth * rng.uniform(0.9, 1.15), height * rng.uniform(0.85, 1.2), rng)]
    if back > 0.9:
        gate = rng.uniform(0.2, 0.7) * wide
        pieces += _edge(lot, ((0.0, gate), (gate + 1.1, wide)), style, rng)
    elif rng.random() < 0.12:  # tables, planters, bins and parcel lockers before shops
        for _ in range(int(rng.integers(1, 4))):
            x = rng.uniform(0.5, wide - 0.5)
            pieces.append(
                solid(
                    Material.WALL, box(lot @ SE2(x, 0.1, rng.normal(0, 0.1)), rng.uniform(0.5, 1.4), 0.5), rng.uniform(0.7, 1.4), whole=True
                )
            )
    return pieces


def _house(lot: SE2, wide: float, height: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """A detached house in its garden, with a driveway, a car on it perhaps, and a boundary of wall, fence or hedge."""
    back = style.setback * rng.uniform(0.8, 1.25)
    drive = 3.0 if wide > 12.0 else 0.0
    left = rng.random() < 0.5
    start = (drive if left else 0.0) + rng.uniform(0.6, 1.6)
    size = max(5.5, min(wide - drive - rng.uniform(1.5, 3.0), 1.3 * style.front))
    deep = style.depth * rng.uniform(0.75, 1.05)
    pieces = [building(lot @ SE2(start, back + 0.5, rng.normal(0.0, 0.02)), size, deep, rng.uniform(4.5, 8.0), rng, calm=0.4)]
    path = start + rng.uniform(0.3, 0.7) * size
    gaps = sorted(((path - 0.6, path + 0.6), *(((0.2, drive + 0.2) if left else (wide - drive - 0.2, wide - 0.2),) if drive else ())))
    spans, begin = [], 0.0
    for low, high in gaps:
        spans.append((begin, low))
        begin = high
    pieces += _edge(lot, (*spans, (begin, wide)), style, rng)
    side = _one_of(rng, ((Material.FENCE, 0.5), (Material.HEDGE, 0.3), (Material.WALL, 0.2)))
    pieces.append(_boundary(side, lot.apply(np.array(((0.0, 0.6), (0.0, back + deep + rng.uniform(4.0, 9.0))))), style, rng))
    middle = drive / 2 + 0.2 if left else wide - drive / 2 - 0.2
    if drive and rng.random() < 0.6:
        pieces.append(parked(lot @ SE2(middle, rng.uniform(2.9, 3.6), math.copysign(math.pi / 2, rng.normal()) + rng.normal(0, 0.03)), rng))
    if drive and rng.random() < 0.5:  # a garage
        pieces.append(
            solid(Material.BUILDING, (lot @ SE2(middle - 1.5, back + rng.uniform(5.0, 8.0), 0.0)).apply(_rectangle(3.0, 6.0)), 2.6)
        )
    for _ in range(int(rng.integers(0, 3))):
        pieces += tree(lot @ SE2(rng.uniform(1.0, wide - 1.0), rng.uniform(0.8, max(1.0, back - 0.8)), 0.0), rng, small=True)
    return pieces


def _forecourt(lot: SE2, wide: float, height: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """A shop behind its own parking places, square to the street."""
    pieces = [building(lot @ SE2(0.4, 8.4 + rng.uniform(0.0, 3.0), 0.0), wide - 0.8, style.depth * 1.2, rng.uniform(4.0, 6.5), rng)]
    for x in np.arange(2.0, wide - 1.6, 2.6):
        if rng.random() < style.parked:
            pieces.append(parked(lot @ SE2(x + rng.normal(0, 0.1), 4.4 + rng.normal(0, 0.2), math.pi / 2 + rng.normal(0, style.skew)), rng))
    pieces.append(solid(Material.POLE, box(lot @ SE2(0.8, 0.6, 0.0), 0.3, 0.3), 5.0, whole=True))
    return pieces


def _green(lot: SE2, wide: float, height: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """A small park or playground: trees, an edge of hedge or railings with a way in, benches."""
    pieces = _edge(lot, ((0.0, 0.45 * wide), (0.45 * wide + 1.6, wide)), style, rng) if rng.random() < 0.7 else []
    for _ in range(int(wide / rng.uniform(4.0, 7.0)) + 1):
        pieces += tree(lot @ SE2(rng.uniform(1.0, wide - 1.0), rng.uniform(1.2, 16.0), 0.0), rng)
    for _ in range(int(rng.integers(0, 3))):
        pieces.append(
            solid(
                Material.WALL,
                box(lot @ SE2(rng.uniform(2.0, wide - 2.0), rng.uniform(1.2, 3.0), rng.normal(0, 0.1)), 1.7, 0.5),
                0.8,
                whole=True,
            )
        )
    return pieces


def _yard(lot: SE2, wide: float, height: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """A wall or fence with a gate, open or shut, sheds and vehicles behind it."""
    gate, size = rng.uniform(0.2, 0.6) * wide, rng.uniform(3.0, 4.5)
    material = _one_of(rng, ((Material.WALL, 0.5), (Material.FENCE, 0.5)))
    spans = ((0.0, gate), (gate + size, wide)) if rng.random() < 0.6 else ((0.0, wide),)
    pieces = [_boundary(material, lot.apply(np.array(((low, EDGE), (high, EDGE)))), style, rng) for low, high in spans if high - low > 0.5]
    pieces.append(
        building(
            lot @ SE2(rng.uniform(0.0, 2.0), rng.uniform(8.0, 12.0), rng.normal(0, 0.03)), wide * 0.8, 7.0, rng.uniform(3.0, 5.0), rng, 0.6
        )
    )
    for _ in range(int(rng.integers(0, 4))):
        pieces.append(parked(lot @ SE2(rng.uniform(2.5, max(3.0, wide - 2.5)), rng.uniform(4.0, 7.0), rng.uniform(0, math.tau)), rng))
    return pieces


def _hall(lot: SE2, wide: float, height: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """A market hall or works: one long, plain, straight front."""
    return [
        building(lot @ SE2(0.5, rng.uniform(1.5, 5.0), 0.0), wide - 1.0, rng.uniform(15.0, 20.0), rng.uniform(6.0, 9.0), rng, calm=0.75)
    ]


def _colonnade(lot: SE2, wide: float, height: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """A front that stands back on the ground floor, the storeys above it on a row of pillars."""
    deep, spacing = rng.uniform(2.6, 3.6), rng.uniform(3.2, 4.6)
    pieces = [building(lot @ SE2(0.0, deep + 0.5, 0.0), wide, style.depth, height, rng)]
    for x in np.arange(0.5, wide - 0.3, spacing):
        pieces.append(solid(Material.WALL, box(lot @ SE2(x, 0.4, 0.0), 0.5, 0.5), 3.4, whole=True))
    pieces.append(solid(Material.OVERHEAD, (lot @ SE2(0.0, 0.15, 0.0)).apply(_rectangle(wide, deep)), height, 3.4))
    return pieces


def _bare(lot: SE2, wide: float, height: float, style: Style, rng: np.random.Generator) -> list[Piece]:
    """Grass, gravel or asphalt, with a tree or two perhaps: nothing that bounds the street."""
    return [
        piece
        for _ in range(int(rng.poisson(wide / 25.0)))
        for piece in tree(lot @ SE2(rng.uniform(0.5, wide - 0.5), rng.uniform(0.8, 15.0), 0.0), rng)
    ]


_LOTS: dict[str, Callable[[SE2, float, float, Style, np.random.Generator], list[Piece]]] = {
    "row": _row,
    "house": _house,
    "forecourt": _forecourt,
    "green": _green,
    "yard": _yard,
    "hall": _hall,
    "colonnade": _colonnade,
    "bare": _bare,
}


def _one_of(rng: np.random.Generator, shares: tuple[tuple[M, float], ...]) -> M:
    """One of these, each with its share of all."""
    return shares[int(rng.choice(len(shares), p=[share for _, share in shares]))][0]


def _rectangle(wide: float, deep: float) -> Floats:
    return np.array(((0.0, 0.0), (wide, 0.0), (wide, deep), (0.0, deep)))


def _edge(lot: SE2, spans: tuple[tuple[float, float], ...], style: Style, rng: np.random.Generator) -> list[Piece]:
    """The boundary to the pavement, of one kind, open between the spans (m along the lot)."""
    material = _one_of(rng, ((Material.WALL, 0.35), (Material.HEDGE, 0.3), (Material.FENCE, 0.25), (None, 0.1)))
    if material is None:
        return []
    inset = 0.65 if material is Material.HEDGE else EDGE
    return [_boundary(material, lot.apply(np.array(((low, inset), (high, inset)))), style, rng) for low, high in spans if high - low > 0.5]


def _boundary(material: Material, line: Floats, style: Style, rng: np.random.Generator) -> Piece:
    """A garden wall, fence or hedge along a line."""
    if material is Material.HEDGE:
        return Piece(material, shapely.buffer(shapely.linestrings(line), rng.uniform(0.3, 0.5), cap_style="flat"), rng.uniform(1.0, 2.0))
    return sheet(material, line, style.wall * rng.uniform(0.85, 1.2) if material is Material.WALL else rng.uniform(1.0, 2.0))


def tree(place: SE2, rng: np.random.Generator, small: bool = False) -> list[Piece]:
    """A trunk and, overhead, its crown."""
    trunk = rng.uniform(0.07, 0.15) if small else rng.uniform(0.12, 0.35)
    crown = rng.uniform(1.0, 2.0) if small else rng.uniform(1.8, 3.8)
    low = rng.uniform(2.1, 3.0)
    pieces = [solid(Material.TREE, disc(place.x, place.y, trunk, 8), low, whole=True)]
    if low > 2.2 and not small:
        pieces.append(solid(Material.OVERHEAD, disc(place.x, place.y, crown, 9), low + 2 * crown, low, whole=True))
    return pieces
