"""The line through a route that a driver keeps to: right of the centre, round the corners, with its limits and stop lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echogrid.core.messages import Floats
from echogrid_training.streets.network import Kind, Leg, Network
from echogrid_training.streets.shapes import directions, distances, length, offset, part, resample, smooth


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """A line with, per point, the leg of the route it belongs to and the speed people drive there."""

    line: Floats  # (N, 2) m
    leg: Floats  # (N,) index into `legs`
    limit: Floats  # (N,) m/s
    legs: tuple[Leg, ...]
    stops: tuple[float, ...]  # m along the line, where one gives way before a junction

    def leg_at(self, place: float) -> Leg:
        walked = distances(self.line)
        return self.legs[int(self.leg[min(int(np.searchsorted(walked, place)), len(walked) - 1)])]


def lane_along(network: Network, legs: Sequence[Leg], aside: float | None = None) -> Lane:
    """Of a route of at least one leg. `aside` m right of the centre lines instead of each street's own lane."""
    pieces: list[Floats] = []
    owners: list[Floats] = []
    limits: list[Floats] = []
    gives_way = []
    for place, leg in enumerate(legs):
        street = network.streets[leg.street]
        centre = smooth(street.towards(leg.forward), 1.5)
        shift = street.lane() if aside is None else aside
        line = offset(centre, -shift) if shift else centre
        long = length(line)
        begin = min(network.reach[network.last_node(legs[place - 1])], 0.4 * long) if place else 0.0
        end = long - (min(network.reach[network.last_node(leg)], 0.4 * long) if place + 1 < len(legs) else 0.0)
        piece = resample(part(line, begin, end), 0.5)
        if pieces:
            curve = _turn(pieces[-1], piece)
            pieces.append(curve)
            owners.append(np.full(len(curve), place))
            limits.append(np.full(len(curve), min(network.streets[legs[place - 1].street].limit, street.limit)))
        pieces.append(piece)
        owners.append(np.full(len(piece), place))
        limits.append(np.full(len(piece), street.limit))
        # One gives way where streets meet, but not within a roundabout nor out of it.
        meets = place + 1 < len(legs) and network.meeting[network.last_node(leg)] > 2
        gives_way.append((sum(map(len, pieces)) - 1, meets and street.kind is not Kind.RING))
    line = np.concatenate(pieces)
    walked = distances(line)
    stops = tuple(float(walked[index]) for index, meets in gives_way if meets)
    return Lane(line, np.concatenate(owners), np.concatenate(limits), tuple(legs), stops)


def _turn(before: Floats, after: Floats) -> Floats:
    """From the end of one line to the start of the next, tangent to both: a cubic Bézier curve without its ends."""
    start, end = before[-1], after[0]
    gap = float(np.hypot(*(end - start)))
    came, goes = directions(before)[-1], directions(after)[0]
    handle = 0.39 * gap  # 0.39 chords make a quarter circle
    share = np.linspace(0.0, 1.0, max(3, round(gap / 0.5) + 1))[1:-1, None]
    first, second = start + handle * came, end - handle * goes
    curve: Floats = (1 - share) ** 3 * start + 3 * (1 - share) ** 2 * share * first + 3 * (1 - share) * share**2 * second + share**3 * end
    return curve
