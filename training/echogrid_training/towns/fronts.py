"""Lots along both sides of a street, from corner to corner."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from echogrid_training.streets.network import Kind, Network, Street
from echogrid_training.streets.shapes import length, offset
from echogrid_training.streets.style import Style
from echogrid_training.towns.lots import line_front
from echogrid_training.towns.piece import Piece

ALLEY_LOTS = (("row", 3.0), ("yard", 1.0))


def fronts(network: Network, street: Street, style: Style, rng: np.random.Generator) -> list[Piece]:
    """What lines a street; nothing lines the ways of car parks and roundabouts."""
    if street.kind in (Kind.AISLE, Kind.RING):
        return []
    pieces = []
    for forward in (True, False):
        border = offset(street.towards(forward), street.width / 2 + street.side(forward, right=False).width)
        begin = _corner(network, street, forward, at_start=True)
        end = length(border) - _corner(network, street, forward, at_start=False)
        if end - begin > 4.0:
            pieces += line_front(border, begin, end, replace(style, lots=ALLEY_LOTS) if street.kind is Kind.ALLEY else style, rng)
    return pieces


def _corner(network: Network, street: Street, forward: bool, at_start: bool) -> float:
    """How far from a street's end the fronts on its left begin, m: away from it only where another street leaves on that side."""
    node = street.ends[0 if forward == at_start else 1]
    mine = _heading(street, node)
    taken = 0.0
    for other in network.streets:
        if other is street or node not in other.ends:
            continue
        turn = _heading(other, node) - mine
        if 0.2 < math.remainder(turn if at_start else -turn, math.tau) % math.tau < 2.8:
            taken = max(taken, other.width / 2 + max(other.left.width, other.right.width))
    return taken


def _heading(street: Street, node: int) -> float:
    """Of a street as it leaves a node, rad."""
    line = street.towards(street.ends[0] == node)
    ahead = line[min(2, len(line) - 1)] - line[0]
    return math.atan2(ahead[1], ahead[0])
