"""Other traffic: cars before, behind and across the ego's way, cyclists at the kerb, pedestrians on pavements and across the street.

Only the car behind the ego reacts to it: whatever would come too close to it, to others or to standing things is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import shapely

from echogrid.core.messages import Floats
from echogrid_training.driving.ego_drive import BODY, Drive
from echogrid_training.driving.lane import lane_along
from echogrid_training.driving.pace import Manner, Run, clip, track
from echogrid_training.driving.steering import follow
from echogrid_training.streets.network import Kind, Leg, Network, wander
from echogrid_training.streets.shapes import distances, frame_at, length, offset, part, ramp, smooth
from echogrid_training.towns.clearance import ego_corners, mover_corners, overlapping, resampled, swept
from echogrid_training.towns.parking import vehicle
from echogrid_training.towns.town import Material, Mover, Thing, Track, observed_by_car

RATE = 20.0  # Hz, of movers' tracks
FROM_EGO, FROM_OTHERS, FROM_THINGS = 0.7, 0.4, 0.2  # m that everybody keeps; half a sample's way at most adds to the first
PEDESTRIAN = (0.45, 0.55, 1.75)
CYCLIST = (1.8, 0.6, 1.75)
Maker = Callable[[Network, Drive, np.random.Generator], Mover | None]


def traffic(network: Network, way: Drive, things: Sequence[Thing], rng: np.random.Generator, busy: float = 1.0) -> tuple[Mover, ...]:
    """About the ego during all of its drive; `busy` scales how many."""
    ego = ego_corners(resampled(way.ego, RATE), BODY)
    shapes = [_shape(thing) for thing in things if observed_by_car(thing.material) and thing.bottom < 2.0]
    standing = shapely.STRtree(shapes)
    seconds = float(way.ego.time[-1])
    usual: tuple[tuple[Maker, float], ...] = ((_car, 7.0), (_cyclist, 2.5), (_pedestrian, 9.0))  # in a minute's drive
    wanted = {kind: int(rng.poisson(mean * busy * math.sqrt(seconds / 60.0))) for kind, mean in usual}
    movers: list[Mover] = []
    outlines: list[Floats] = []
    for mover in _candidates(network, way, wanted, rng):
        mine = mover_corners(mover)
        close = overlapping(mine, ego, FROM_EGO).any() or any(overlapping(mine, other, FROM_OTHERS).any() for other in outlines)
        if not close and not standing.query(swept(mine), predicate="dwithin", distance=FROM_THINGS).size:
            movers.append(mover)
            outlines.append(mine)
    return tuple(movers)


def _candidates(network: Network, way: Drive, wanted: dict[Maker, int], rng: np.random.Generator) -> Iterator[Mover]:
    """More of each kind than are wanted, for some will not fit."""
    behind = _follower(way.ego, rng) if rng.random() < 0.5 else None
    if behind is not None:
        yield behind
    for kind, count in wanted.items():
        for _ in range(2 * count):
            mover = kind(network, way, rng)
            if mover is not None:
                yield mover


def _shape(thing: Thing) -> shapely.Geometry:
    return shapely.polygons(thing.outline) if thing.closed else shapely.linestrings(thing.outline)


def _start(network: Network, way: Drive, rng: np.random.Generator) -> Leg:
    """Somewhere the ego comes by, or a street that crosses there; in either direction."""
    leg = way.legs[int(rng.integers(max(1, len(way.legs) * 2 // 3)))]
    if rng.random() < 0.4:
        across = network.onwards(leg)
        leg = across[int(rng.integers(len(across)))][0] if across else leg
    against = not network.streets[leg.street].one_way and rng.random() < 0.6
    return Leg(leg.street, not leg.forward) if against else leg


def _car(network: Network, way: Drive, rng: np.random.Generator) -> Mover | None:
    """A car on a route of its own."""
    long, wide, high = vehicle(rng)
    seconds = float(way.ego.time[-1])
    legs = wander(network, _start(network, way, rng), 7.0 * seconds, rng)
    if not legs:
        return None
    lane = lane_along(network, legs)
    begin = rng.uniform(0.0, 30.0)
    line = part(lane.line, begin, min(begin + 7.0 * seconds, length(lane.line)))
    course = follow(frame_at(line, 0.0), line)
    places = begin + course.progress
    limit = rng.uniform(0.75, 1.0) * np.interp(places, distances(lane.line), lane.limit)
    halts = tuple((stop - begin, rng.uniform(0.5, 6.0)) for stop in lane.stops if rng.random() < 0.4 and stop > begin + 2.0)
    run = Run(course, limit, halts)
    return _moving(Material.CAR, (long, wide, high), run, Manner(rng.uniform(1.2, 1.8), rng.uniform(1.4, 2.0)), seconds, rng)


def _cyclist(network: Network, way: Drive, rng: np.random.Generator) -> Mover | None:
    """Near the kerb."""
    start = _start(network, way, rng)
    seconds, street = float(way.ego.time[-1]), network.streets[start.street]
    legs = wander(network, start, 6.0 * seconds, rng) if street.kind is not Kind.RING else []
    if not legs:
        return None
    lane = lane_along(network, legs, aside=min(network.streets[leg.street].width for leg in legs) / 2 - rng.uniform(0.6, 0.9))
    begin = rng.uniform(0.0, 40.0)
    line = part(lane.line, begin, length(lane.line))
    course = follow(frame_at(line, 0.0), line, lookahead=2.5, agility=0.15, tightest=0.4)
    halts = tuple((stop - begin, rng.uniform(0.5, 4.0)) for stop in lane.stops if rng.random() < 0.25 and stop > begin + 2.0)
    run = Run(course, np.full(len(course.curvature), rng.uniform(3.0, 6.5)), halts)
    return _moving(Material.CYCLIST, CYCLIST, run, Manner(0.8, 1.5, 1.5), seconds, rng)


def _pedestrian(network: Network, way: Drive, rng: np.random.Generator) -> Mover | None:
    """On a pavement, standing now and then; some cross the street on the way."""
    start = _start(network, way, rng)
    seconds, street = float(way.ego.time[-1]), network.streets[start.street]
    if street.kind is Kind.RING:
        return None
    own, opposite = street.side(start.forward, right=True), street.side(start.forward, right=False)
    reach = [
        street.width / 2 + (side.parking.value + rng.uniform(0.3, 0.7) * side.pavement if side.pavement > 0.8 else -0.4)
        for side in (own, opposite)
    ]
    pace = rng.uniform(0.8, 1.7)
    crosses = rng.random() < 0.35
    legs = [start] if crosses else wander(network, start, 1.6 * seconds + 30.0, rng)
    if not legs:
        return None
    if crosses:
        centre = smooth(street.towards(start.forward), 1.5)
        places = distances(centre)
        middle = rng.uniform(0.3, 0.7) * places[-1]
        across = ramp((places - middle) / rng.uniform(4.0, 9.0))
        line = offset(centre, -(reach[0] - across * (reach[0] + reach[1])))
    else:
        line = lane_along(network, legs, aside=reach[0]).line
    begin = rng.uniform(0.0, 0.5 * min(length(line), length(street.line)))
    line = part(line, begin, length(line))
    if rng.random() < 0.5 and not crosses:
        line = line[::-1]  # the other way, on the same pavement
        line = part(line, max(0.0, length(line) - 1.6 * seconds - rng.uniform(0.0, 30.0)), length(line))
    if length(line) < 3.0:
        return None
    course = follow(frame_at(line, 0.0), line, lookahead=1.0, agility=3.0, tightest=2.0)
    waits = tuple((rng.uniform(0.1, 0.9) * course.length, rng.uniform(1.0, 8.0)) for _ in range(int(rng.integers(0, 3))))
    run = Run(course, np.full(len(course.curvature), pace), waits)
    return _moving(Material.PEDESTRIAN, PEDESTRIAN, run, Manner(1.0, 1.0, 1.0), seconds, rng)


def _moving(
    material: Material, size: tuple[float, float, float], run: Run, manner: Manner, seconds: float, rng: np.random.Generator
) -> Mover:
    """Under way at time 0, unless the way is short."""
    whole = track([run], manner, RATE)
    spare = float(whole.time[-1]) - seconds
    return Mover(material, *size, clip(whole, min(rng.uniform(3.0, 12.0), max(0.0, spare)), seconds))


def _follower(ego: Track, rng: np.random.Generator) -> Mover | None:
    """The car behind, by the intelligent driver model (Treiber et al. 2000), on the ego's own line; `None` if the ego reverses."""
    coarse = resampled(ego, RATE)
    if coarse.speed.min() < -0.01:
        return None
    long, wide, high = vehicle(rng)
    before = 22.0  # m of straight line behind where the ego starts
    walked = before + np.concatenate(([0.0], np.cumsum((coarse.speed[1:] + coarse.speed[:-1]) / 2 / RATE)))
    most, gap_wanted, headway, accelerate, brake = rng.uniform(9.0, 14.0), rng.uniform(1.8, 3.0), rng.uniform(1.0, 1.6), 1.5, 1.8
    place, speed = walked[0] - BODY.rear_overhang - long / 2 - max(4.0, headway * coarse.speed[0]) - 2.0, float(coarse.speed[0])
    places, speeds = [], []
    for ahead, its_speed in zip(walked, coarse.speed, strict=True):
        places.append(place)
        speeds.append(speed)
        gap = max(ahead - BODY.rear_overhang - long / 2 - place, 0.1)
        wish = gap_wanted + max(0.0, speed * headway + speed * (speed - its_speed) / (2 * math.sqrt(accelerate * brake)))
        change = accelerate * (1.0 - (speed / most) ** 4 - (wish / gap) ** 2)
        slower = max(0.0, speed + max(change, -6.0) / RATE)
        place += (speed + slower) / 2 / RATE
        speed = slower
    moved = np.flatnonzero(np.diff(walked, prepend=walked[0] - 1.0) > 1e-6)
    line = walked[moved]
    yaw = np.interp(places, line, coarse.yaw[moved])
    straight = np.minimum(np.array(places) - before, 0.0)
    x = np.interp(places, line, coarse.x[moved]) + straight * math.cos(coarse.yaw[0])
    y = np.interp(places, line, coarse.y[moved]) + straight * math.sin(coarse.yaw[0])
    return Mover(Material.CAR, long, wide, high, Track(coarse.time, x, y, yaw, np.array(speeds), np.gradient(yaw) * RATE))
