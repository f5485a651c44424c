"""Outlines of buildings: fronts with doors, bays and steps rather than rectangles."""

from __future__ import annotations

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.towns.piece import Piece, solid
from echogrid_training.towns.town import Material


def building(lot: SE2, wide: float, deep: float, top: float, rng: np.random.Generator, calm: float = 0.0) -> Piece:
    """Its front along the lot's x axis from 0 to `wide`, its back at y = `deep`; `calm` of its features are left out."""
    outline = np.concatenate((_front(wide, rng, calm), _back(wide, deep, rng)))
    return solid(Material.BUILDING, lot.apply(outline), top)


def _front(wide: float, rng: np.random.Generator, calm: float) -> Floats:
    """(N, 2) from x = 0 to `wide` near y = 0: recessed doors, bays that stand out, steps where two parts meet."""
    points, x, level = [(0.0, 0.0)], rng.uniform(0.6, 2.5), 0.0
    while x < wide - 2.2:
        kind = rng.random()
        if rng.random() < calm:
            x += rng.uniform(2.0, 6.0)
            continue
        if kind < 0.45:  # a door in its recess
            size, deep = rng.uniform(0.95, 1.6), level + rng.uniform(0.15, 0.8)
        elif kind < 0.75:  # a bay, a porch, steps
            size, deep = rng.uniform(1.2, 2.1), level - rng.uniform(0.1, 0.5)
        else:  # from here on the front stands back or forward
            size, deep = 0.0, level
            step = float(np.clip(level + rng.normal(0.0, 0.25), 0.0, 0.6))
            points += [(x, level), (x, step)]
            level = step
        if size:
            points += [(x, level), (x, deep), (x + size, deep), (x + size, level)]
        x += size + rng.uniform(1.2, 4.5)
    points.append((wide, level))
    return np.array(points)


def _back(wide: float, deep: float, rng: np.random.Generator) -> Floats:
    """(N, 2) from x = `wide` back to 0 near y = `deep`, often with an annexe."""
    if rng.random() < 0.5:
        return np.array(((wide, deep), (0.0, deep)))
    size, out = rng.uniform(0.3, 0.6) * wide, rng.uniform(1.5, 4.0)
    left = rng.uniform(0.0, wide - size)
    return np.array(((wide, deep), (left + size, deep), (left + size, deep + out), (left, deep + out), (left, deep), (0.0, deep)))
