"""Street plans: where the nodes of a town's streets are, and what runs between them. Lengths in m."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely

from echogrid.core.messages import Floats
from echogrid_training.streets.network import Kind
from echogrid_training.streets.style import Style


@dataclass(slots=True)
class Plan:
    """A street plan in the making: nodes, edges between them, and open areas that no building enters."""

    nodes: list[tuple[float, float]] = field(default_factory=list)
    edges: list[tuple[int, int, Kind]] = field(default_factory=list)
    rounds: list[int] = field(default_factory=list)  # nodes that become roundabouts
    open: list[Floats] = field(default_factory=list)  # outlines (N, 2) m
    chains: dict[frozenset[int], list[int]] = field(default_factory=dict)  # what edges were split into, by their ends

    def node(self, x: float, y: float) -> int:
        self.nodes.append((float(x), float(y)))
        return len(self.nodes) - 1

    def edge(self, a: int, b: int, kind: Kind = Kind.STREET) -> None:
        self.edges.append((a, b, kind))

    def split(self, a: int, b: int, share: float) -> int:
        """A node on the way between two nodes, which may have been split before: a new one, or one that is there and near."""
        chain = self.chains.setdefault(frozenset((a, b)), [a, b])
        start, end = (np.array(self.nodes[node]) for node in (a, b))
        shares = [float(np.dot(np.array(self.nodes[node]) - start, end - start) / np.dot(end - start, end - start)) for node in chain]
        if shares[0] > shares[-1]:
            chain.reverse()
            shares.reverse()
        after = int(np.searchsorted(shares, share))
        for place in (after - 1, after):
            if 0 < place < len(chain) - 1 and abs(shares[place] - share) * math.dist(start, end) < 14.0:
                return chain[place]
        one, other = chain[after - 1], chain[after]
        found = next(index for index, edge in enumerate(self.edges) if {edge[0], edge[1]} == {one, other})
        kind = self.edges.pop(found)[2]
        middle = self.node(*(start + share * (end - start)))
        self.edge(one, middle, kind)
        self.edge(middle, other, kind)
        chain.insert(after, middle)
        return middle


def sketch(style: Style, rng: np.random.Generator) -> Plan:
    """A plan of the style's layout about the origin, several blocks each way."""
    plan = Plan()
    layouts = {"brick": _brick, "lane": _lane, "organic": _organic, "multi_storey": _multi_storey}
    layouts.get(style.layout, _grid)(plan, style, rng)
    return plan


def _grid(plan: Plan, style: Style, rng: np.random.Generator) -> None:
    """Jittered rows and columns, a few streets missing, alleys and yards within blocks; perhaps roundabouts or a car park."""
    count = 5
    across = np.cumsum(rng.uniform(0.8, 1.2, count)) * style.block
    up = np.cumsum(rng.uniform(0.8, 1.2, count)) * style.block
    across, up = across - across.mean(), up - up.mean()
    ids = [[plan.node(x + rng.normal(0, 3.0), y + rng.normal(0, 3.0)) for x in across] for y in up]
    missing = {(int(rng.integers(1, count - 1)), int(rng.integers(1, count - 1))) for _ in range(2)}
    for row in range(count):
        for column in range(count):
            if column + 1 < count and (row, column) not in missing:
                plan.edge(ids[row][column], ids[row][column + 1])
            if row + 1 < count:
                plan.edge(ids[row][column], ids[row + 1][column])
    blocks = [(row, column) for row in range(count - 1) for column in range(count - 1) if not {(row, column), (row + 1, column)} & missing]
    for use, (row, column) in enumerate(blocks[index] for index in rng.permutation(len(blocks))[:7]):
        corners = ids[row][column], ids[row][column + 1], ids[row + 1][column + 1], ids[row + 1][column]
        if style.layout in ("car_park", "plaza") and use < 2:
            _car_park(plan, corners)
        elif use < 4:
            bottom = plan.split(corners[0], corners[1], rng.uniform(0.4, 0.6))
            top = plan.split(corners[3], corners[2], rng.uniform(0.4, 0.6))
            plan.edge(bottom, top, Kind.ALLEY)
        else:
            _courtyard(plan, corners, rng)
    if style.layout == "roundabout":
        inner = [ids[row][column] for row in range(1, count - 1) for column in range(1, count - 1)]
        plan.rounds = [inner[index] for index in rng.permutation(len(inner))[:4]]


def _courtyard(plan: Plan, corners: tuple[int, int, int, int], rng: np.random.Generator) -> None:
    """A passage from the street at the bottom of a block into a court in its middle."""
    gate = plan.split(corners[0], corners[1], rng.uniform(0.42, 0.58))
    nodes = [np.array(plan.nodes[corner]) for corner in corners]
    middle = sum(nodes) / 4
    start = np.array(plan.nodes[gate])
    inside = plan.node(*(start + 0.75 * (middle - start) * 1.25))
    plan.edge(gate, inside, Kind.ALLEY)
    half = rng.uniform(8.0, 11.0)
    plan.open.append(np.array(plan.nodes[inside]) + half * np.array(((-1.0, -0.8), (1.0, -0.8), (1.0, 0.9), (-1.0, 0.9))))


def _car_park(plan: Plan, corners: tuple[int, int, int, int]) -> None:
    """Aisles with bays on both sides between two cross aisles, and a way out to the streets below and above the block."""
    nodes = [np.array(plan.nodes[corner]) for corner in corners]
    low, high = (nodes[0] + nodes[1]) / 2, (nodes[3] + nodes[2]) / 2
    gate, back = plan.split(corners[0], corners[1], 0.5), plan.split(corners[3], corners[2], 0.5)
    width = min(abs(nodes[1][0] - nodes[0][0]), abs(nodes[2][0] - nodes[3][0])) - 30.0
    rows = max(2, int(width / 17.5))
    places = (np.arange(rows) - (rows - 1) / 2) * 17.5
    bottom, top = low[1] + 16.0, high[1] - 16.0
    shift = np.interp((bottom, top), (low[1], high[1]), (low[0], high[0]))
    lower = [plan.node(shift[0] + place, bottom) for place in places]
    upper = [plan.node(shift[1] + place, top) for place in places]
    gates = [plan.node(shift[0] + places[0] + 8.75, bottom), plan.node(shift[1] + places[-1] - 8.75, top)]
    for chain, door, before in ((lower, gates[0], 0), (upper, gates[1], rows - 2)):
        order = [*chain[: before + 1], door, *chain[before + 1 :]]
        for a, b in pairwise(order):
            plan.edge(a, b, Kind.AISLE)
    for a, b in zip(lower, upper, strict=True):
        plan.edge(a, b, Kind.AISLE)
    plan.edge(gate, gates[0], Kind.AISLE)
    plan.edge(back, gates[1], Kind.AISLE)
    edge = abs(places[0]) + 9.5
    plan.open.append(
        np.array(
            ((shift[0] - edge, bottom - 4.5), (shift[0] + edge, bottom - 4.5), (shift[1] + edge, top + 4.5), (shift[1] - edge, top + 4.5))
        )
    )


def _brick(plan: Plan, style: Style, rng: np.random.Generator) -> None:
    """Rows of blocks that do not line up: T-junctions, every one."""
    rows, columns = 7, 6
    lines: list[list[int]] = []
    for row in range(rows):
        y = (row - (rows - 1) / 2) * style.block * 0.85
        # On each row street, the ends of the cross streets below it and above it alternate.
        lines.append(
            [
                plan.node((column - columns + 0.5) * style.block * 0.62 + rng.normal(0, 2.0), y + rng.normal(0, 1.5))
                for column in range(2 * columns)
            ]
        )
    for row, ids in enumerate(lines):
        for a, b in pairwise(ids):
            plan.edge(a, b)
        if row + 1 < rows:
            for column in range(row % 2, 2 * columns, 2):
                plan.edge(ids[column], lines[row + 1][column], Kind.ALLEY if rng.random() < 0.12 else Kind.STREET)


def _lane(plan: Plan, style: Style, rng: np.random.Generator) -> None:
    """A village: one winding through road, closes off it that end blind or loop back."""
    ids, heading = [], rng.uniform(-0.3, 0.3)
    x, y = -5 * style.block, 0.0
    for _ in range(13):
        ids.append(plan.node(x, y))
        x, y = x + style.block * 0.8 * math.cos(heading), y + style.block * 0.8 * math.sin(heading)
        heading = -0.5 * heading + rng.normal(0.0, 0.3)
    for a, b in pairwise(ids):
        plan.edge(a, b)
    for side in (1.0, -1.0):
        ends: list[int | None] = []
        for node in ids[1:-1]:
            east, north = plan.nodes[node]
            base = (east + rng.normal(0, 6.0), north + side * style.block * rng.uniform(0.9, 1.1))
            ends.append(plan.node(*base) if rng.random() < 0.85 else None)
            if (end := ends[-1]) is not None:
                plan.edge(node, end)
        for left, right in pairwise(ends):
            if left is not None and right is not None and rng.random() < 0.6:
                plan.edge(left, right)
    plan.rounds = [ids[int(rng.integers(3, 10))]]


def _organic(plan: Plan, style: Style, rng: np.random.Generator) -> None:
    """Streets between scattered centres, as in an old town: forks and bends at all angles, alleys, a roundabout."""
    span = 2.7 * style.block
    cells = [(column + 0.5 * (row % 2), row * 0.87) for row in range(-4, 5) for column in range(-4, 5)]
    centres = np.array(cells) * style.block * 0.95 + rng.normal(0.0, 0.17 * style.block, (len(cells), 2))
    diagram = shapely.voronoi_polygons(shapely.MultiPoint(centres), only_edges=True, ordered=False)
    ids: dict[tuple[int, int], int] = {}
    for piece in shapely.get_parts(shapely.line_merge(diagram) if diagram.geom_type != "MultiLineString" else diagram):
        points = shapely.get_coordinates(piece)
        for start, end in pairwise(points):
            if np.abs(np.stack((start, end))).max() > span:
                continue
            keys = [(round(point[0] / 14.0), round(point[1] / 14.0)) for point in (start, end)]  # junctions that nearly meet are one
            for key, point in zip(keys, (start, end), strict=True):
                if key not in ids:
                    ids[key] = plan.node(*point)
            if ids[keys[0]] != ids[keys[1]] and not any({a, b} == {ids[keys[0]], ids[keys[1]]} for a, b, _ in plan.edges):
                plan.edge(ids[keys[0]], ids[keys[1]], Kind.ALLEY if rng.random() < 0.1 else Kind.STREET)
    inner = [node for node, (x, y) in enumerate(plan.nodes) if max(abs(x), abs(y)) < span - style.block]
    plan.rounds = [inner[index] for index in rng.permutation(len(inner))[:3]]


def _multi_storey(plan: Plan, style: Style, rng: np.random.Generator) -> None:
    """One level of a multi-storey car park, entered from a street that passes it."""
    rows, long = int(rng.integers(3, 5)), rng.uniform(62.0, 84.0)
    places = (np.arange(rows) - (rows - 1) / 2) * 16.6
    lower, upper = ([plan.node(place, y) for place in places] for y in (-long / 2, long / 2))
    for chain in (lower, upper):
        for a, b in pairwise(chain):
            plan.edge(a, b, Kind.AISLE)
    for a, b in zip(lower, upper, strict=True):
        plan.edge(a, b, Kind.AISLE)
    road = -long / 2 - 34.0
    west, gate, out, east = (
        plan.node(x, road + rng.normal(0, 2.0))
        for x in (places[0] - 1.6 * style.block, places[0], places[-1], places[-1] + 1.6 * style.block)
    )
    for a, b in ((west, gate), (gate, out), (out, east)):
        plan.edge(a, b)
    plan.edge(gate, lower[0], Kind.AISLE)
    plan.edge(out, lower[-1], Kind.AISLE)
    edge = abs(places[0]) + 8.6
    plan.open.append(np.array(((-edge, -long / 2 - 4.4), (edge, -long / 2 - 4.4), (edge, long / 2 + 4.4), (-edge, long / 2 + 4.4))))
