"""The streets of a generated town: a plan's edges bent, with widths and sides, and roundabouts where the plan wants them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from echogrid.core.messages import Floats
from echogrid_training.streets.network import Kind, Network, Parking, Side, Street
from echogrid_training.streets.shapes import along, distances, length, part, resample
from echogrid_training.streets.street_plan import Plan, sketch
from echogrid_training.streets.style import Style

WIDE = 8.1  # m of carriageway, from which on people drive faster


@dataclass(frozen=True, slots=True, eq=False)
class StreetPlan:
    """The network, the outlines kept open, and the islands of roundabouts as (x, y, radius) m."""

    network: Network
    open: tuple[Floats, ...]
    islands: tuple[tuple[float, float, float], ...]


def plan_streets(style: Style, rng: np.random.Generator) -> StreetPlan:
    """A town of the style's layout about the origin, several blocks each way."""
    return _built(sketch(style, rng), style, rng)


def _built(plan: Plan, style: Style, rng: np.random.Generator) -> StreetPlan:
    """Streets with widths and sides along the plan's edges, all bent by one smooth field."""
    straight = style.layout in ("multi_storey", "car_park", "plaza")
    bend = _Bend(0.0 if straight else style.warp, rng)
    nodes = [bend(np.array([node]))[0] for node in plan.nodes]
    streets = []
    for a, b, kind in plan.edges:
        line = bend(resample(np.array((plan.nodes[a], plan.nodes[b])), 4.0))
        streets.append(_street((a, b), line, kind, style, rng))
    islands = []
    for node in plan.rounds:
        streets, nodes, island = _round(streets, nodes, node, style)
        islands += island
    kept = tuple(street for street in streets if length(street.line) > 3.0)
    return StreetPlan(Network(np.array(nodes), kept), tuple(bend(outline) for outline in plan.open), tuple(islands))


class _Bend:
    """A smooth displacement of the plane by up to about `reach` m."""

    def __init__(self, reach: float, rng: np.random.Generator) -> None:
        turn, wavelength = rng.uniform(0, math.tau, 4), rng.uniform(170.0, 320.0, 4)
        self._waves = np.stack((np.cos(turn), np.sin(turn)), axis=-1) * (math.tau / wavelength)[:, None]  # (4, 2) 1/m
        self._phases = rng.uniform(0, math.tau, 4)
        self._reach = reach * rng.normal(0.0, 0.6, (4, 2))

    def __call__(self, points: Floats) -> Floats:
        """Points (N, 2) where the bent plane has them."""
        return points + np.sin(points @ self._waves.T + self._phases) @ self._reach


def _street(ends: tuple[int, int], line: Floats, kind: Kind, style: Style, rng: np.random.Generator) -> Street:
    """With a width, a speed and sides as streets of that kind have."""
    if kind is Kind.ALLEY:
        return Street(
            ends, line, style.alley * rng.uniform(0.97, 1.03), rng.uniform(3.0, 4.5), kind, Side(pavement=0.3), Side(pavement=0.3)
        )
    if kind is Kind.AISLE:
        bays = Side(Parking.ANGLED if rng.random() < 0.25 else Parking.ACROSS, 0.3)
        if length(line) < 36.0:  # cross aisles and ways in
            bays = Side(pavement=0.3)
        return Street(ends, line, 6.0, rng.uniform(3.0, 4.5), kind, bays, bays)
    sides = []
    for _ in range(2):
        parking = Parking(float(rng.choice((0.0, 2.1, 4.7, 5.1), p=(0.3, 0.48, 0.09, 0.13))))
        sides.append(Side(parking, style.pavement * rng.uniform(0.9, 1.15)))
    fastest = 13.9 if style.carriageway < WIDE else 18.0
    return Street(ends, line, style.carriageway * rng.uniform(0.97, 1.05), rng.uniform(8.3, fastest), kind, sides[0], sides[1])


def _round(
    streets: list[Street], nodes: list[Floats], node: int, style: Style
) -> tuple[list[Street], list[Floats], list[tuple[float, float, float]]]:
    """A roundabout in the place of a node: its streets end on a one-way ring about it."""
    touching = [index for index, street in enumerate(streets) if node in street.ends]
    centre, radius, wide = np.asarray(nodes[node]), style.ring, 5.6
    room = all(length(streets[index].line) > radius + 25.0 and streets[index].kind is Kind.STREET for index in touching)
    if len(touching) < 3 or not room:
        return streets, nodes, []
    nodes = list(nodes)
    changed, arms = list(streets), []
    for index in touching:
        street = streets[index]
        outward = street.line if street.ends[0] == node else street.line[::-1]
        start = float(np.interp(radius, np.hypot(*(outward - centre).T), distances(outward)))
        rest = part(outward, start, length(outward))
        nodes.append(along(outward, np.array([start]))[0])
        arm = len(nodes) - 1
        ends = (arm, street.ends[1]) if street.ends[0] == node else (street.ends[0], arm)
        line = rest if street.ends[0] == node else rest[::-1]
        changed[index] = Street(ends, line, street.width, street.limit, street.kind, street.left, street.right)
        arms.append((math.atan2(*(nodes[arm] - centre)[::-1]), arm))
    arms.sort()
    turns = np.diff([turn for turn, _ in arms], append=arms[0][0] + math.tau)
    if turns.min() * radius < 9.0:  # arms too close for a ring between them
        return streets, nodes[: len(nodes) - len(touching)], []
    for (turn, arm), (_, onward), bend in zip(arms, arms[1:] + arms[:1], turns, strict=True):
        angles = turn + np.linspace(0.0, bend, max(4, round(bend * radius / 1.5)))
        line = centre + radius * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
        changed.append(Street((arm, onward), line, wide, 6.0, Kind.RING, Side(), Side(pavement=style.pavement), one_way=True))
    return changed, nodes, [(float(centre[0]), float(centre[1]), radius - wide / 2)]
