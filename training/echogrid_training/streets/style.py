"""What towns of a family look like: ranges to draw each town's habits from, disjoint from family to family, and layouts of their own.

In the family `open` hardly anything bounds the road: wide streets with room beside them, few houses, few parked cars, many small things.
Held out for test: the organic street plan (streets that fork at odd angles), the multi-storey car park, and colonnades.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Family:
    """Per family, from where to where (SI) each habit is drawn, the layouts, and the weights of what lines its streets."""

    block: Range  # m between crossings
    warp: Range  # m by which streets wind
    carriageway: Range  # m
    pavement: Range  # m
    alley: Range  # m wide
    ring: Range  # m, radius of roundabouts
    front: Range  # m along the street of a building in a row
    depth: Range  # m, of buildings
    setback: Range  # m from the pavement to detached houses
    storeys: Range  # m, heights of buildings in rows
    parked: Range  # share of the parking spaces taken
    pitch: Range  # m per space along the kerb
    lamps: Range  # m from lamp post to lamp post
    trees: Range  # m from tree to tree in a row
    wall: Range  # m, heights of garden walls
    skew: Range  # rad, one sigma of how crookedly people park
    layouts: tuple[str, ...]
    small: float  # 0 no small things beside and on the road, 1 all kinds of them
    lots: tuple[tuple[str, float], ...]


@dataclass(frozen=True, slots=True)
class Style:
    """One town's habits, drawn from its family's ranges."""

    block: float
    warp: float
    carriageway: float
    pavement: float
    alley: float
    ring: float
    front: float
    depth: float
    setback: float
    storeys: float
    parked: float
    pitch: float
    lamps: float
    trees: float
    wall: float
    skew: float
    layout: str
    small: float
    lots: tuple[tuple[str, float], ...]


FAMILIES = {
    "train": Family(
        block=(70.0, 92.0),
        warp=(3.0, 9.0),
        carriageway=(6.0, 7.0),
        pavement=(1.9, 3.0),
        alley=(3.4, 4.0),
        ring=(10.0, 13.0),
        front=(9.0, 16.0),
        depth=(9.0, 12.0),
        setback=(2.5, 5.5),
        storeys=(7.0, 14.0),
        parked=(0.45, 0.75),
        pitch=(5.9, 6.6),
        lamps=(24.0, 32.0),
        trees=(7.5, 12.0),
        wall=(0.9, 1.7),
        skew=(0.015, 0.035),
        layouts=("grid", "grid", "roundabout", "car_park"),
        small=0.5,
        lots=(("row", 4.0), ("house", 3.0), ("forecourt", 0.7), ("green", 0.8), ("yard", 0.6), ("hall", 0.4)),
    ),
    "calibration": Family(
        block=(56.0, 68.0),
        warp=(0.5, 2.8),
        carriageway=(5.5, 5.95),
        pavement=(1.5, 1.85),
        alley=(3.1, 3.35),
        ring=(8.5, 9.8),
        front=(6.0, 8.8),
        depth=(7.5, 8.8),
        setback=(5.8, 8.0),
        storeys=(5.0, 6.8),
        parked=(0.3, 0.43),
        pitch=(6.7, 7.4),
        lamps=(33.0, 40.0),
        trees=(12.5, 17.0),
        wall=(1.75, 2.2),
        skew=(0.036, 0.05),
        layouts=("brick", "brick", "lane"),
        small=0.0,
        lots=(("row", 3.0), ("house", 4.0), ("forecourt", 0.6), ("green", 1.0), ("yard", 0.5)),
    ),
    "test": Family(
        block=(94.0, 115.0),
        warp=(9.5, 14.0),
        carriageway=(7.1, 8.0),
        pavement=(3.1, 4.2),
        alley=(4.1, 4.8),
        ring=(13.5, 17.0),
        front=(16.5, 24.0),
        depth=(12.5, 16.0),
        setback=(0.8, 2.3),
        storeys=(14.5, 24.0),
        parked=(0.78, 0.95),
        pitch=(5.4, 5.85),
        lamps=(17.0, 23.0),
        trees=(5.0, 7.3),
        wall=(0.5, 0.85),
        skew=(0.004, 0.013),
        layouts=("organic", "organic", "multi_storey"),
        small=0.0,
        lots=(("row", 4.0), ("house", 1.5), ("colonnade", 1.5), ("forecourt", 0.7), ("green", 0.8), ("yard", 0.5)),
    ),
    "open": Family(
        block=(116.0, 150.0),
        warp=(14.2, 20.0),
        carriageway=(8.2, 19.0),
        pavement=(4.3, 6.0),
        alley=(4.9, 5.6),
        ring=(17.2, 20.0),
        front=(24.2, 30.0),
        depth=(16.2, 20.0),
        setback=(8.2, 13.0),
        storeys=(3.2, 4.8),
        parked=(0.02, 0.29),
        pitch=(7.5, 9.0),
        lamps=(40.5, 60.0),
        trees=(17.5, 30.0),
        wall=(0.3, 0.48),
        skew=(0.051, 0.09),
        layouts=("wide", "wide", "plaza"),
        small=1.0,
        lots=(("bare", 5.0), ("green", 1.0), ("forecourt", 1.0), ("house", 0.7), ("yard", 0.5), ("hall", 0.5), ("row", 0.5)),
    ),
}
LIKE_ALL = ("layouts", "small", "lots")  # fields that are no ranges


def draw(family: Family, rng: np.random.Generator) -> Style:
    """A town's habits."""
    names = [field.name for field in fields(Family) if field.name not in LIKE_ALL]
    drawn = {name: float(rng.uniform(*getattr(family, name))) for name in names}
    return Style(**drawn, layout=str(rng.choice(family.layouts)), small=family.small, lots=family.lots)
