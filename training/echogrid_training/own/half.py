"""A drive mapped from some of its scans, asked by the others: what the map said where each was about to measure, and says at the end.

The map is asked as it stood when the scan came, so nothing that came later helps it.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.config.tables import Config
from echogrid.core.map.look_map import STEP, TURN
from echogrid.core.map.tiled_map import TiledMap
from echogrid.core.mapper import Mapper
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.pipeline import Pipeline
from echogrid_training.evaluation.recorded.drive import FARTHEST, STEP_NS, RealDrive, Reflections, reflections
from echogrid_training.evaluation.recorded.elfes import along
from echogrid_training.evaluation.recorded.scores import Rectangle, reached

STRETCH = 50.0  # m of way: what is drawn for intervals, and what adaptation learns from or is scored on
BEFORE = 1.0  # m before a detection at which its ray no longer counts as passed: a place is uncertain by that much at times
EVERY = 4  # cells along a ray from one that is asked to the next
AROUND = FARTHEST + 5.0  # m around the car that are read
ROOM = {"max_tiles": 1 << 20, "max_mib": 1 << 13}  # of the map: a drive is judged whole

Key = tuple[str, int]  # sensor and stamp of a scan


@dataclass(frozen=True, slots=True, eq=False)
class Answers:
    """What the map said at places (N,) of rays that it was not shown."""

    stretch: NDArray[np.int64]  # number of the drive's stretch
    radar: NDArray[np.int64]  # number of the radar in the configuration
    range: Floats  # m
    age: Floats  # s since the map last had the place in view, whole; inf where it never had
    log_odds: Floats  # 0 where nothing is known
    reach: Floats  # the largest of the cell and its four neighbours, -inf where none is known
    hit: NDArray[np.bool_]  # the ray ended there; else it passed, and every EVERY-th cell of its way is asked

    def __len__(self) -> int:
        return len(self.hit)

    def where(self, which: NDArray[np.bool_]) -> Answers:
        return Answers(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    @staticmethod
    def empty() -> Answers:
        whole, real = np.empty(0, np.int64), np.empty(0)
        return Answers(whole, whole, real, real, real, real, np.empty(0, np.bool_))

    @staticmethod
    def joined(parts: list[Answers]) -> Answers:
        return Answers(*(np.concatenate([getattr(one, name) for one in parts]) for name in Answers.__dataclass_fields__))


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """One scan that was left out, from a place half a metre from that radar's last: nothing is asked twice from one place."""

    radar: int
    stretch: int
    found: Reflections
    ego: EgoState  # in the map's odom


@dataclass(slots=True, eq=False)
class Half:
    """The newest map of a drive. What belongs to maps before it, which began elsewhere, is in `answers` alone."""

    map: TiledMap
    model: str  # which, and why
    answers: list[Answers] = field(default_factory=list)  # of fresh looks
    looks: list[Look] = field(default_factory=list)
    left_out: list[Floats] = field(default_factory=list)  # (T, 2) m in odom, of all scans that were left out
    driven: list[EgoState] = field(default_factory=list)  # every 100 ms
    stretches: list[int] = field(default_factory=list)  # of `driven`
    way: float = 0.0  # m, of all maps
    maps: int = 1


def halve(drive: RealDrive, config: Config, left_out: Collection[Key]) -> Half:
    """Maps the drive without some scans, given by sensor and stamp, and asks the map about them."""
    pipeline = roomy(drive, config)
    return driven_through(drive, pipeline.mapper, pipeline.model.why, left_out, ask=True)


def roomy(drive: RealDrive, config: Config) -> Pipeline:
    """That forgets no tile."""
    return Pipeline(msgspec.structs.replace(config, map=msgspec.structs.replace(config.map, **ROOM)), drive.config)


def driven_through(drive: RealDrive, mapper: Mapper, model: str, left_out: Collection[Key], *, ask: bool) -> Half:
    """Without `ask` the looks are kept and no map is asked."""
    radars = {name: number for number, name in enumerate(mapper.mounts)}
    out, waiting, last = Half(mapper.map, model), list[RadarScan](), dict[str, SE2]()
    epoch = mapper.epoch
    for now_ns, item in drive.items:
        if isinstance(item, RadarScan) and (item.sensor, item.stamp_ns) in left_out:
            waiting.append(item)
        else:
            for _ in mapper.take(item, now_ns):
                pass
        mapper.update(now_ns)
        if mapper.epoch != epoch:
            epoch = mapper.epoch
            out.maps += 1
            waiting.clear()
            last.clear()
            for held in (out.looks, out.left_out, out.driven, out.stretches):
                held.clear()
        if not mapper.odometry.states:
            continue
        newest = mapper.odometry.states[-1]
        out.way = mapper.odometry.distance
        stretch = int(out.way // STRETCH)
        if not out.driven or newest.stamp_ns - out.driven[-1].stamp_ns >= STEP_NS:
            out.driven.append(newest)
            out.stretches.append(stretch)
        due = [scan for scan in waiting if scan.stamp_ns <= newest.stamp_ns]
        for scan in due:
            waiting.remove(scan)
            ego = mapper.odometry.at(scan.stamp_ns)
            if ego is not None:
                _ask(out, mapper, scan, ego, radars[scan.sensor], stretch, last, ask=ask)
    mapper.end_cycle()
    return out


def _ask(out: Half, mapper: Mapper, scan: RadarScan, ego: EgoState, radar: int, stretch: int, last: dict[str, SE2], *, ask: bool) -> None:
    found = reflections(scan, ego, mapper.mounts[scan.sensor])
    out.left_out.append(found.points)
    here, before = ego.odom_from_base, last.get(scan.sensor)
    if before is not None and math.hypot(here.x - before.x, here.y - before.y) < STEP and abs(here.yaw - before.yaw) < TURN:
        return
    last[scan.sensor] = here
    out.looks.append(Look(radar, stretch, found, ego))
    if ask and len(found.range):
        out.answers.append(answers(mapper.map, found, ego, radar, stretch))


def answers(occupancy: TiledMap, found: Reflections, ego: EgoState, radar: int, stretch: int) -> Answers:
    """What a map says where the rays of one scan ended and where they passed."""
    cell = occupancy.spec.cell
    size = 2 * math.ceil(AROUND / cell)
    row, column = (math.floor(value / cell) - size // 2 for value in (ego.odom_from_base.y, ego.odom_from_base.x))
    where = Rectangle(row, column, size, size, cell)
    log_odds = where.read(occupancy)
    reach = reached(np.where(log_odds == 0, np.float32(-np.inf), log_odds)).reshape(-1)
    seen_s, _ = occupancy.window_of_views(where.row, where.column, size, size)
    passed, ray = along(found.origin, found.bearing, found.range - BEFORE, BEFORE, EVERY * cell)
    places = np.concatenate((found.points, passed))
    flat = where.flat(places)
    inside = flat >= 0
    flat, count = flat[inside], int(inside.sum())
    seen = seen_s.reshape(-1)[flat]
    return Answers(
        stretch=np.full(count, stretch),
        radar=np.full(count, radar),
        range=np.hypot(*(places[inside] - found.origin).T),
        age=np.where(seen == 0, np.inf, np.maximum(scan_s(ego) - seen.astype(float), 0.0)),
        log_odds=log_odds.reshape(-1)[flat].astype(float),
        reach=reach[flat].astype(float),
        hit=np.concatenate((np.ones(len(found.range), bool), np.zeros(len(ray), bool)))[inside],
    )


def scan_s(ego: EgoState) -> int:
    """Unix time in whole seconds, as a map notes it."""
    return max(ego.stamp_ns // 1_000_000_000, 1)
