"""The streets of a town as a graph: what the ego's route, the traffic, the fronts and the parked cars are laid along."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from echogrid.core.messages import Floats
from echogrid_training.streets.shapes import length, offset

SHARPEST = math.radians(125.0)  # a route turns no sharper from street to street


class Kind(Enum):
    """What a street is for."""

    STREET = "street"
    ALLEY = "alley"  # one car wide, walls or fronts close by
    RING = "ring"  # of a roundabout
    AISLE = "aisle"  # of a car park


class Parking(Enum):
    """How cars stand beside a carriageway; the value is the depth of their strip in m."""

    NONE = 0.0
    ALONG = 2.1
    ANGLED = 4.7
    ACROSS = 5.1


@dataclass(frozen=True, slots=True)
class Side:
    """What lies beside the carriageway: a strip to park on, then a pavement (m), then the fronts."""

    parking: Parking = Parking.NONE
    pavement: float = 0.0

    @property
    def width(self) -> float:
        """From the carriageway to the fronts, m."""
        return self.parking.value + self.pavement


@dataclass(frozen=True, slots=True, eq=False)
class Street:
    """A carriageway of `width` m along `line` (N, 2) from node to node; traffic keeps right; `limit` is what people drive there in m/s."""

    ends: tuple[int, int]
    line: Floats
    width: float
    limit: float
    kind: Kind = Kind.STREET
    left: Side = Side()
    right: Side = Side()
    one_way: bool = False

    def side(self, forward: bool, right: bool) -> Side:
        """That on the right (or left) hand of someone who drives along the street or against it."""
        return self.right if forward == right else self.left

    def towards(self, forward: bool) -> Floats:
        """The centre line in the direction of travel."""
        return self.line if forward else self.line[::-1]

    def lane(self) -> float:
        """From the centre line to the middle of a car that drives there, to its right in m."""
        return 0.0 if self.one_way else max(0.0, min(self.width / 4, self.width / 2 - 1.5))

    def band(self, beyond: float = 0.0) -> Floats:
        """(M, 2) closed outline of everything between the fronts of both sides, and so much more on each."""
        left = offset(self.line, self.width / 2 + self.left.width + beyond)
        right = offset(self.line, -(self.width / 2 + self.right.width + beyond))
        return np.concatenate((right, left[::-1]))


@dataclass(frozen=True, slots=True)
class Leg:
    """A street (its index), driven along its line or against it."""

    street: int
    forward: bool


@dataclass(frozen=True, eq=False)  # no slots: who meets where is worked out once
class Network:
    """Streets that meet at nodes (N, 2) m."""

    nodes: Floats
    streets: tuple[Street, ...]

    @cached_property
    def leaving(self) -> dict[int, list[Leg]]:
        """The ways out of each node."""
        ways: dict[int, list[Leg]] = defaultdict(list)
        for index, street in enumerate(self.streets):
            ways[street.ends[0]].append(Leg(index, True))
            if not street.one_way:
                ways[street.ends[1]].append(Leg(index, False))
        return ways

    @cached_property
    def meeting(self) -> dict[int, int]:
        """How many ends of streets each node has."""
        counts: dict[int, int] = defaultdict(int)
        for street in self.streets:
            counts[street.ends[0]] += 1
            counts[street.ends[1]] += 1
        return counts

    @cached_property
    def reach(self) -> dict[int, float]:
        """How far from each node a turn begins, m: the widest street's half width and the kerb's radius."""
        reach: dict[int, float] = defaultdict(float)
        for street in self.streets:
            kerb = 2.5 if street.kind is Kind.RING else 5.5
            for node in street.ends:
                reach[node] = max(reach[node], street.width / 2 + kerb)
        return reach

    def last_node(self, leg: Leg) -> int:
        return self.streets[leg.street].ends[1 if leg.forward else 0]

    def onwards(self, leg: Leg) -> list[tuple[Leg, float]]:
        """Where one may go from the end of a leg, and the turn (rad) there: not back, and not round a corner too sharp for a car."""
        line = self.streets[leg.street].towards(leg.forward)
        came = math.atan2(*(line[-1] - line[max(0, len(line) - 4)])[::-1])
        ways = []
        for way in self.leaving[self.last_node(leg)]:
            onward = self.streets[way.street].towards(way.forward)
            goes = math.atan2(*(onward[min(3, len(onward) - 1)] - onward[0])[::-1])
            turn = math.remainder(goes - came, math.tau)
            if way.street != leg.street and abs(turn) < SHARPEST:
                ways.append((way, turn))
        return ways


def wander(network: Network, start: Leg, wanted: float, rng: np.random.Generator, patience: int = 400) -> list[Leg]:
    """A random route of at least `wanted` m from the start of `start`, new streets rather than old; empty where there is none."""
    legs, choices = [start], [_shuffled(network, start, [], rng)]
    done = [length(network.streets[start.street].line)]
    while done[-1] < wanted:
        patience -= 1
        if not legs or patience < 0:
            return []
        if not choices[-1]:  # a dead end: back to the last choice
            legs.pop()
            choices.pop()
            done.pop()
            if not legs:
                return []
            continue
        way = choices[-1].pop()
        choices.append(_shuffled(network, way, legs, rng))
        legs.append(way)
        done.append(done[-1] + length(network.streets[way.street].line))
    return legs


def _shuffled(network: Network, leg: Leg, driven: list[Leg], rng: np.random.Generator) -> list[Leg]:
    """Ways on from a leg, the one to try first last: streets not driven yet before others, and rather straight on than not."""
    ways = network.onwards(leg)
    straight = [rng.random() + 0.5 * math.cos(turn) for _, turn in ways]
    seen = {old.street for old in driven} | {leg.street}
    order = sorted(range(len(ways)), key=lambda index: (ways[index][0].street not in seen, straight[index]))
    return [ways[index][0] for index in order]
