"""The drivable roads of an extract as a network: widths and speeds by class and tags, split where they meet."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from echogrid.core.messages import Floats
from echogrid_training.streets.network import Kind, Network, Parking, Side, Street
from echogrid_training.streets.osm_extract import Tags, Way, metres
from echogrid_training.streets.shapes import length, offset

# Width of a two-way carriageway in m and what people drive there in m/s.
CLASSES = {
    "trunk": (13.0, 16.0),
    "primary": (11.0, 13.5),
    "secondary": (9.5, 13.0),
    "tertiary": (8.0, 12.0),
    "unclassified": (6.6, 10.0),
    "residential": (6.4, 9.0),
    "living_street": (5.5, 5.0),
    "service": (4.6, 4.5),
}
CAR_ROOM = 1.4  # m that a road's centre line keeps from buildings, or it is not for cars
PAVED = 2.2  # m of pavement


def network_from(roads: Sequence[Way], buildings: shapely.STRtree, rng: np.random.Generator) -> Network:
    """Of the roads that a car can drive in the open, on the ground."""
    ways = [way for way in roads if _drivable(way.tags)]
    uses = Counter(node for way in ways for node in way.nodes)
    pieces: list[tuple[list[int], Floats, Tags]] = []
    for way in ways:
        start = 0
        for place in range(1, len(way.nodes)):
            if place == len(way.nodes) - 1 or uses[way.nodes[place]] > 1:
                pieces.append(([way.nodes[start], way.nodes[place]], way.line[start : place + 1], way.tags))
                start = place
    numbers: dict[int, int] = {}
    places: list[Floats] = []
    streets = []
    for ends, line, tags in pieces:
        for node, place in zip(ends, (line[0], line[-1]), strict=True):
            if node not in numbers:
                numbers[node] = len(places)
                places.append(place)
        if ends[0] != ends[1] and length(line) > 0.5:
            street = _street((numbers[ends[0]], numbers[ends[1]]), line, tags)
            streets.append(street)
    return Network(
        np.array(places).reshape(-1, 2), tuple(_fitted(street, buildings, rng) for street in _joined(streets) if _open(street, buildings))
    )


def _drivable(tags: Tags) -> bool:
    covered = tags.get("tunnel", "no") != "no" or tags.get("covered", "no") != "no" or tags.get("bridge", "no") != "no"
    level = tags.get("layer", "0") in ("0", "")
    shut = tags.get("access") in ("no", "private") or tags.get("motor_vehicle") in ("no", "private")
    return tags["highway"].removesuffix("_link") in CLASSES and level and not covered and not shut and tags.get("area") != "yes"


def _street(ends: tuple[int, int], line: Floats, tags: Tags) -> Street:
    """As mapped; what nobody mapped, as its class usually is."""
    kind = tags["highway"]
    wide, pace = CLASSES[kind.removesuffix("_link")]
    one_way = tags.get("oneway") in ("yes", "-1", "1", "true") or tags.get("junction") in ("roundabout", "circular")
    lanes = metres(tags.get("lanes"))
    if tags.get("service") == "parking_aisle":
        wide = 6.0
    elif lanes:
        wide = 3.2 * lanes + (0.8 if lanes < 2 else 0.0)
    elif one_way:
        wide = max(4.2, 0.6 * wide)
    elif kind.endswith("_link"):
        wide = 5.0
    limit = metres(tags.get("maxspeed"))
    speed = min(pace, limit / 3.6) if limit else pace
    back = tags.get("oneway") == "-1"
    sides = [_side(tags, name, kind) for name in ("left", "right")]
    use = Kind.AISLE if kind == "service" else Kind.RING if tags.get("junction") == "roundabout" else Kind.STREET
    wide = float(np.clip(metres(tags.get("width")) or wide, 3.2, 20.0))
    street = Street(ends, line, wide, max(speed, 3.0), use, sides[0], sides[1], one_way)
    return replace(street, ends=ends[::-1], line=line[::-1], left=sides[1], right=sides[0]) if back else street


def _side(tags: Tags, side: str, kind: str) -> Side:
    """Parking as tagged, else along the kerb of small streets."""
    tagged = tags.get(f"parking:{side}") or tags.get("parking:both")
    how = tags.get(f"parking:{side}:orientation") or tags.get("parking:both:orientation") or "parallel"
    pavement = 0.3 if kind == "service" else PAVED
    if tagged in ("no", "separate"):
        return Side(Parking.NONE, pavement)
    if tagged is not None:
        return Side({"diagonal": Parking.ANGLED, "perpendicular": Parking.ACROSS}.get(how, Parking.ALONG), pavement)
    return Side(Parking.ALONG if kind in ("residential", "unclassified", "tertiary", "living_street") else Parking.NONE, pavement)


def _joined(streets: list[Street]) -> list[Street]:
    """Streets that only go on into one another made one, so that a bend mapped as two ways is no junction."""
    left: dict[int, Street] = dict(enumerate(streets))
    at: dict[int, set[int]] = defaultdict(set)
    for index, street in left.items():
        for node in street.ends:
            at[node].add(index)
    for node in sorted(at):
        meeting = sorted(at[node])
        if len(meeting) != 2:
            continue
        one, other = (left[index] for index in meeting)
        if one.one_way != other.one_way or one.kind is not other.kind or abs(one.width - other.width) > 1.5:
            continue
        if one.one_way:
            if one.ends[0] == node:
                one, other = other, one
            if one.ends[1] != node or other.ends[0] != node:
                continue
        else:
            one = one if one.ends[1] == node else _turned(one)
            other = other if other.ends[0] == node else _turned(other)
        if one.ends[0] == other.ends[1] or _bend(one.line, other.line) > math.radians(50.0):
            continue
        whole = replace(
            one, ends=(one.ends[0], other.ends[1]), line=np.concatenate((one.line, other.line[1:])), width=min(one.width, other.width)
        )
        keep, gone = meeting
        left[keep] = whole
        del left[gone]
        at[other.ends[1]].discard(gone)
        at[one.ends[0]].discard(gone)
        at[other.ends[1]].add(keep)
        at[one.ends[0]].add(keep)
        at[node] = set()
    return list(left.values())


def _turned(street: Street) -> Street:
    return replace(street, ends=street.ends[::-1], line=street.line[::-1], left=street.right, right=street.left)


def _bend(before: Floats, after: Floats) -> float:
    came, goes = before[-1] - before[-2], after[1] - after[0]
    return abs(math.remainder(math.atan2(goes[1], goes[0]) - math.atan2(came[1], came[0]), math.tau))


def _open(street: Street, buildings: shapely.STRtree) -> bool:
    """Whether a car could follow the centre line: arches and passages are left out."""
    return not buildings.query(shapely.linestrings(street.line), predicate="dwithin", distance=CAR_ROOM).size


def _fitted(street: Street, buildings: shapely.STRtree, rng: np.random.Generator) -> Street:
    """No wider than there is room between the buildings, with parking only where it fits."""
    line = shapely.linestrings(street.line)
    nearest = shapely.distance(line, buildings.geometries[buildings.nearest(line)])
    width = float(min(street.width, 2 * (nearest - 0.2)))
    sides = []
    for side, sign in ((street.left, 1.0), (street.right, -1.0)):
        fits = rng.random() < 0.7 and length(street.line) > 20.0
        if side.parking is not Parking.NONE and fits:
            edge = shapely.linestrings(offset(street.line, sign * (width / 2 + side.parking.value / 2)))
            fits = not buildings.query(edge, predicate="dwithin", distance=side.parking.value / 2 + 0.8).size
        sides.append(side if fits else Side(Parking.NONE, side.pavement))
    return replace(street, width=width, left=sides[0], right=sides[1])
