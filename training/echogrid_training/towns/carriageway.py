"""The ground that cars drive and park on."""

from __future__ import annotations

from collections.abc import Sequence

import shapely

from echogrid_training.streets.network import Network, Parking, Street
from echogrid_training.streets.shapes import length, offset, part
from echogrid_training.towns.parking import stretch

KERB_RADIUS = 3.5  # m, where streets meet


def carriageways(network: Network, streets: Sequence[Street]) -> shapely.Geometry:
    """Of these streets with their parking strips, the kerbs rounded where streets meet."""
    roads = shapely.union_all([shapely.buffer(shapely.linestrings(street.line), street.width / 2, quad_segs=3) for street in streets])
    roads = shapely.buffer(shapely.buffer(roads, KERB_RADIUS, quad_segs=4), -KERB_RADIUS, quad_segs=4)
    strips = []
    for street in streets:
        begin, end = stretch(network, street)
        for side, sign in ((street.left, 1.0), (street.right, -1.0)):
            if side.parking is not Parking.NONE and end - begin > 6.0:
                middle = offset(street.line, sign * (street.width / 2 + side.parking.value / 2))
                # The offset line of a bent street is longer or shorter than the street.
                share = length(middle) / length(street.line)
                line = shapely.linestrings(part(middle, begin * share, end * share))
                strips.append(shapely.buffer(line, side.parking.value / 2 + 0.05, cap_style="flat"))
    return shapely.union_all([roads, *strips])
