"""One person's drive through a network of streets: out of a parking space or on the move, waiting here and there, perhaps parking again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from echogrid.config.tables import Body
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2, arc
from echogrid_training.driving.lane import Lane, lane_along
from echogrid_training.driving.pace import Manner, Run, clip, track
from echogrid_training.driving.steering import STEP, Course, follow
from echogrid_training.streets.network import Kind, Leg, Network, Parking, wander
from echogrid_training.streets.shapes import distances, frame_at, length, offset, part, ramp
from echogrid_training.towns.town import Track

BODY = Body()
TYPICAL = 5.0  # m/s over a whole drive, for the first guess of its length


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """The ego's track and the route it took."""

    ego: Track
    legs: tuple[Leg, ...]


def drive(network: Network, seconds: float, rng: np.random.Generator, possible: Callable[[Track], bool] | None = None) -> Drive | None:
    """A drive of so many seconds that `possible` agrees to, `None` if none was found."""
    usable = [leg for ways in network.leaving.values() for leg in ways if network.streets[leg.street].kind is not Kind.RING]
    if not usable:
        return None
    manner = Manner(rng.uniform(1.2, 1.7), rng.uniform(1.3, 1.8), rng.uniform(1.3, 1.75))
    for _ in range(80):
        start = usable[int(rng.integers(len(usable)))]
        legs = wander(network, start, 1.1 * TYPICAL * seconds + 60.0, rng)
        if not legs:
            continue
        lane = lane_along(network, legs)
        ego = _drive_along(network, lane, seconds, manner, rng)
        if ego is not None and (possible is None or possible(ego)):
            return Drive(ego, tuple(legs))
    return None


def _drive_along(network: Network, lane: Lane, seconds: float, manner: Manner, rng: np.random.Generator) -> Track | None:
    """From somewhere near the lane's start; of its end only as much as the time allows."""
    leaves = _leaving(network, lane, rng)
    begin = leaves.place if leaves else 0.0
    skipped = 0.0 if leaves else float(rng.choice((0.0, rng.uniform(4.0, 12.0))))
    parks = rng.random() < 0.45
    total = float(distances(lane.line)[-1])
    pace, wanted = rng.uniform(0.85, 1.1), begin + TYPICAL * (seconds + skipped)
    waits = [(rng.uniform(0.1, 0.9), rng.uniform(1.5, 6.0)) for _ in range(int(rng.integers(0, 2)))]
    holds = [(stop, rng.uniform(0.6, 5.0)) for stop in lane.stops if rng.random() < 0.25]
    slows = [stop for stop in lane.stops if rng.random() < 0.5]
    whole = None
    for _ in range(4):  # the end of the lane is where the time is up
        end = min(wanted, total - 3.0)
        if end < begin + 25.0:
            return None
        runs = leaves.runs[:] if leaves else []
        ending = _ending(network, lane, end, rng) if parks else _Ending(part(lane.line, 0.0, end), ())
        halts = (*holds, *((begin + share * (end - begin), wait) for share, wait in waits))
        main = _main(lane, ending.line, begin, leaves.pose if leaves else None, halts, slows, pace, rng)
        runs.append(main)
        if ending.back:
            runs.append(_slowly(follow(main.course.end, np.array(ending.back), reverse=True, lookahead=1.8, agility=0.25), rng, rest=1.0))
        whole = track(runs, manner)
        lasts = float(whole.time[-1]) - skipped
        spare = lasts - seconds
        if (not parks and spare >= 0.0) or (parks and -8.0 < spare <= 0.0):
            break
        if not parks and end >= total - 3.0:
            return None
        wanted = end - (spare + 3.0 if parks else spare - 8.0) * (end - begin) / max(lasts, 5.0)
    if whole is None or not (whole.time[-1] - skipped > 0.7 * seconds):
        return None
    if parks and whole.time[-1] - skipped > seconds:  # join it under way so that the parking is seen
        skipped = float(whole.time[-1]) - seconds if not leaves else skipped
    return clip(whole, skipped, seconds)


def _main(
    lane: Lane,
    line: Floats,
    begin: float,
    pose: SE2 | None,
    halts: tuple[tuple[float, float], ...],
    slows: list[float],
    pace: float,
    rng: np.random.Generator,
) -> Run:
    """Forwards along the lane from `begin`, from a pose beside it or on it."""
    ahead = part(line, begin, length(line))
    ahead = offset(ahead, _weave(len(ahead), distances(ahead), rng))
    course = follow(pose or frame_at(ahead, 0.0), ahead)
    places = begin + course.progress
    limit = pace * np.interp(places, distances(lane.line), lane.limit)
    for stop in slows:  # looks both ways
        limit = np.where(np.abs(places - stop) < 3.0, np.minimum(limit, 4.5), limit)
    held = []
    for place, wait in halts:
        reached = int(np.searchsorted(places, place))
        if 0 < reached < len(places):
            held.append((reached * STEP, wait))
    return Run(course, limit, tuple(held), rest=1.0)


def _weave(count: int, places: Floats, rng: np.random.Generator) -> Floats:
    """(N,) m: no one drives in the exact middle of the lane, except at its ends."""
    drift = sum(rng.normal(0.0, 0.07) * np.sin(places * (2 * math.pi / rng.uniform(20.0, 70.0)) + rng.uniform(0, 6)) for _ in range(3))
    return np.asarray(drift + np.zeros(count)) * ramp(places / 10.0) * ramp((places[-1] - places) / 15.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Start:
    """How a drive begins beside the lane: what is driven first, where that ends, and where along the lane."""

    runs: list[Run]
    pose: SE2
    place: float


def _leaving(network: Network, lane: Lane, rng: np.random.Generator) -> _Start | None:
    """Out of a space beside the lane's first street, of the kind there is; `None`: starts in the lane."""
    leg = lane.legs[0]
    street = network.streets[leg.street]
    parking = street.side(leg.forward, right=True).parking
    first = float(distances(lane.line)[lane.leg == 0][-1])
    place = float(rng.uniform(14.0, max(14.5, min(first - 12.0, 45.0))))
    if first < 30.0 or rng.random() < 0.25:
        return None
    aside = street.width / 2 - street.lane()  # from the lane to the kerb
    here = frame_at(lane.line, place)
    if parking is Parking.ALONG:
        pose = here @ SE2(0.0, -(aside + rng.uniform(0.9, 1.1)), rng.normal(0.0, 0.02))
        return _Start([], pose, place)
    if parking is Parking.NONE and street.kind is not Kind.STREET:
        return None
    if parking is Parking.NONE and rng.random() < 0.5:
        return None
    turn = math.radians(rng.uniform(50.0, 60.0) if parking is Parking.ANGLED else 90.0) + rng.normal(0.0, 0.02)
    deep = rng.uniform(0.9, 1.3) + (2.0 if parking is Parking.NONE else 0.0)  # a driveway is longer than a bay
    space = here @ SE2(0.0, -aside, -turn) @ SE2(deep, 0.0, 0.0)
    out = turn - math.radians(rng.uniform(36.0, 48.0))  # turned back by so much before going forwards
    straight = deep + rng.uniform(0.6, 1.2) if turn > 1.2 else deep
    backwards = [space]
    while len(backwards) * 0.25 < straight:
        backwards.append(backwards[-1] @ SE2(-0.25, 0.0, 0.0))
    radius, bend = 5.8, 0.0
    while bend < out:
        backwards.append(backwards[-1] @ arc(-0.25, 0.25 / radius))
        bend += 0.25 / radius
    line = np.array([(pose.x, pose.y) for pose in backwards])
    course = follow(space, line, reverse=True, lookahead=1.5, agility=0.25)
    runs = [_standing(space, rng.uniform(1.0, 4.0)), _slowly(course, rng, rest=rng.uniform(0.8, 2.0))]
    behind = here.inverse() @ course.end
    return _Start(runs, course.end, max(0.0, place + behind.x + 1.5))


def _standing(pose: SE2, seconds: float) -> Run:
    """Hardly a move: the seat belt, the mirrors."""
    return Run(Course(pose, True, np.zeros(2), np.zeros(2), pose @ SE2(-STEP, 0.0, 0.0)), np.full(2, 0.3), rest=seconds)


def _slowly(course: Course, rng: np.random.Generator, rest: float) -> Run:
    return Run(course, np.full(len(course.curvature), rng.uniform(1.0, 1.8)), rest=rest)


@dataclass(frozen=True, slots=True, eq=False)
class _Ending:
    """The line forwards to the end, and (if any) back into the space from there."""

    line: Floats
    back: tuple[tuple[float, float], ...]


def _ending(network: Network, lane: Lane, end: float, rng: np.random.Generator) -> _Ending:
    """Into a space on the right near `end` m along the lane, of the kind there is; on the lane where there is none."""
    leg = lane.leg_at(end)
    street = network.streets[leg.street]
    parking = street.side(leg.forward, right=True).parking
    plain = part(lane.line, 0.0, end)
    if end < 30.0 or lane.leg_at(end - 16.0) != leg:  # no room to get there from the last corner
        return _Ending(plain, ())
    aside = street.width / 2 - street.lane()
    if parking is Parking.ALONG:
        shift = aside + 1.0
        if rng.random() < 0.5:  # forwards into a long gap
            places = distances(plain)
            return _Ending(offset(plain, -shift * ramp((places - (end - 13.0)) / 10.5)), ())
        back = np.linspace(0.0, 10.5, 43)
        points = frame_at(lane.line, end).apply(np.stack((-back, -shift * ramp((back - 0.5) / 8.5)), axis=-1))
        return _Ending(plain, tuple(map(tuple, points.tolist())))
    if parking in (Parking.ACROSS, Parking.ANGLED):
        turn = math.radians(90.0 if parking is Parking.ACROSS else 55.0)
        return _Ending(_nose_in(lane, end, aside, turn), ())
    return _Ending(plain, ())


def _nose_in(lane: Lane, end: float, aside: float, turn: float) -> Floats:
    """The lane, a swing to its left, and a right turn into a bay that begins `aside` m right of it."""
    radius, deep = 6.0, 1.1
    bay = frame_at(lane.line, end) @ SE2(0.0, -aside, -turn) @ SE2(deep, 0.0, 0.0)
    poses = [bay]
    for _ in range(round(radius * turn / 0.25)):  # back out of the bay along an arc, until along the lane
        poses.append(poses[-1] @ arc(-0.25, 0.25 * turn / (round(radius * turn / 0.25) * 0.25)))
    out = np.array([(pose.x, pose.y) for pose in poses[::-1]])
    frame = frame_at(lane.line, end).inverse()
    begins = frame.apply(out[:1])[0]
    before = part(lane.line, 0.0, end + float(begins[0]) - 1.0)
    places = distances(before)
    return np.concatenate((offset(before, float(begins[1]) * ramp((places - (places[-1] - 13.0)) / 12.0)), out))
