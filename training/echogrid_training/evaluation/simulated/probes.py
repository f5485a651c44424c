"""What happens to maps in particular moments: a cold start, a long stand, and the same way driven twice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import msgspec
import numpy as np

from echogrid.core.map.tiled_map import LogOdds, probability
from echogrid.core.mapper import Mapper
from echogrid.core.messages import RadarScan, Speed, YawRate
from echogrid.core.motion.se2 import SE2
from echogrid_training.evaluation.simulated.baselines import Elfes
from echogrid_training.evaluation.simulated.learned import Key, Network
from echogrid_training.evaluation.simulated.maps import Geometry, Row, Stop, View, drive_through, mappers, replayed, rows, view
from echogrid_training.evaluation.simulated.tape import Event, Tape, play
from echogrid_training.learning.dataset import SPEC

STARTS = (0.2, 0.4, 0.6, 0.8)  # shares of the drive
LOOKS = (1, 3, 10)  # after which a map that began empty is judged
STEP = 0.5  # m of way, one look
STANDING = 60  # s
SECOND = 1_000_000_000  # ns


def cold_starts(tape: Tape, geometry: Geometry, networks: Mapping[Key, Network], tuned: Sequence[Elfes] = ()) -> Iterator[tuple[int, View]]:
    """Maps, and histories, that begin empty in the midst of the drive: the looks so far, and the view around the car."""
    for share in STARTS:
        of = rows(tape, geometry, networks, tuned)
        left, way, last = list(LOOKS), 0.0, None
        for ego in play(tape.events[int(share * len(tape.events)) :], mappers(of)):
            here = ego.odom_from_base
            way += 0.0 if last is None else float(np.hypot(here.x - last.x, here.y - last.y))
            last = here
            pose = tape.truth.pose(ego.stamp_ns)
            if pose is not None and way >= left[0] * STEP:
                yield left.pop(0), view("cold", tape, of, Stop(here, pose))
                if not left:
                    break


def revisits(tape: Tape, of: Sequence[Row]) -> Iterator[View]:
    """The drive once more over maps that it has made before: the views of the maps after that."""
    for seen in drive_through(tape, replayed(tape, of)):
        if seen.level == "finished":
            yield replace(seen, level="revisited")


def standstill(tape: Tape, geometry: Geometry, networks: Mapping[Key, Network]) -> dict[Key, float]:
    """The largest change of any cell's published probability from the second second of standing to the STANDINGth, by map.

    In the middle of the drive the car stops, and every radar measures over and over what it measured last, now without motion.
    """
    of, before = rows(tape, geometry, networks, ()), tape.events[: len(tape.events) // 2]
    of = [row for row in of if row.published]
    last: SE2 | None = None
    for ego in play([*before, *braking(before)], mappers(of)):
        last = ego.odom_from_base
    if last is None:
        return {}
    changes = {row.key: 0.0 for row in of}
    first: dict[Key, LogOdds] = {}
    for events in standing(before, STANDING):
        for _ in play(events, mappers(of)):
            pass
        for row in of:
            p = _published(row.mapper, last)
            changes[row.key] = max(changes[row.key], float(np.abs(p - first.setdefault(row.key, p)).max()))
    return changes


def _published(mapper: Mapper, odom_from_base: SE2) -> LogOdds:
    _, _, window = mapper.map.around(odom_from_base, 2 * SPEC.cells)
    return probability(window)


def braking(before: Sequence[Event]) -> list[Event]:
    """The second after these events: the car slows down evenly to a stop, and no radar is heard."""
    items = [item for event in before for item in event.items]
    speed = next(item.speed for item in reversed(items) if isinstance(item, Speed))
    yaw_rate = next(item.yaw_rate for item in reversed(items) if isinstance(item, YawRate))
    times = [before[-1].now_ns + (step + 1) * SECOND // 100 for step in range(100)]
    left = np.linspace(1.0, 0.0, 100)
    return [
        Event((Speed(now, speed * share), YawRate(now, yaw_rate * share)), now) for now, share in zip(times, left.tolist(), strict=True)
    ]


def standing(before: Sequence[Event], seconds: int) -> Iterator[list[Event]]:
    """A car that stands after these events and its `braking`, second by second: every radar's newest scan again, with the range rate of
    what stands.

    Scans come as they came, `before`'s last second over and over; ego motion a hundred times a second.
    """
    newest: dict[str, RadarScan] = {item.sensor: item for event in before for item in event.items if isinstance(item, RadarScan)}
    end = before[-1].now_ns
    times = [
        (item.received_ns - end, item.sensor)
        for event in before
        if event.now_ns > end - SECOND
        for item in event.items
        if isinstance(item, RadarScan)
    ]
    for number in range(2, seconds + 2):
        shift = number * SECOND
        events = [Event((_again(newest[sensor], end + ago + shift),), end + ago + shift) for ago, sensor in times]
        for step in range(100):
            now = end + shift - SECOND + (step + 1) * SECOND // 100
            events.append(Event((Speed(now, 0.0), YawRate(now, 0.0)), now))
        yield sorted(events, key=lambda event: event.now_ns)


def _again(scan: RadarScan, received_ns: int) -> RadarScan:
    age = scan.received_ns - scan.stamp_ns
    return msgspec.structs.replace(scan, stamp_ns=received_ns - age, received_ns=received_ns, range_rate=np.zeros_like(scan.range_rate))
