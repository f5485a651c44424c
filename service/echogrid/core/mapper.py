"""The spine: from scans and ego motion to the map, one cycle at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.beams import Beams
from echogrid.core.evidence.history import Detections, History, Looks, Surroundings
from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.health import Health
from echogrid.core.kernels.sweeps import GateVerdict, Scan
from echogrid.core.map.tiled_map import Shelf, TiledMap, View
from echogrid.core.messages import EgoMotion, Floats, PoseFix, RadarScan
from echogrid.core.motion.error_filter import Certainty, ErrorFilter
from echogrid.core.motion.map_frame import MapFrame
from echogrid.core.motion.odometry import EgoState, Odometry
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.doppler_errors import DopplerErrors
from echogrid.core.radar.gathering import Gathering
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.seen_again import SeenAgain
from echogrid.core.radar.static_gate import GateNoise, gated
from echogrid.core.radar.sweep import Sweep
from echogrid.core.trust.motion_watch import BACK, GAP, GOOD, IMPLAUSIBLE, JUMP
from echogrid.core.trust.watch import Watch

EVER = -(2**63)  # ns, before all times
NEW_MAP = (GAP, BACK, JUMP)  # verdicts
BACK_NS = 1_000_000_000  # frames of several buses come out of order by less

Infer = Callable[[Surroundings], Image]  # what one update says about the cells around the car, as the map's `integrate` takes it


class Judged(msgspec.Struct, frozen=True, eq=False):
    """All detections of the trusted radars in one cycle that are near enough, in the order of the scans, and what the gate said of each:
    picked out of all (N,) where somebody asks."""

    all_points: Floats  # (N, 2) m, base frame
    scan: NDArray[np.int64]  # (N,) number of the scan
    numbers: Sequence[int]  # (S,) of the scans' radars in the configuration
    all_verdicts: NDArray[np.uint8]  # (N,) UNASKED for those that are too far

    STATIC: ClassVar[int] = int(GateVerdict.STATIC)  # went into the map
    MOVING: ClassVar[int] = int(GateVerdict.MOVING)  # by its range rate
    BESIDE: ClassVar[int] = int(GateVerdict.BESIDE)  # seems to stand, but lies beside some that move: dropped with them
    UNASKED: ClassVar[int] = int(GateVerdict.UNASKED)

    def near(self) -> tuple[Floats, NDArray[np.uint8], NDArray[np.uint8]]:
        """Those that are near enough: their points (K, 2), numbers (K,) of their radars in the configuration, and verdicts (K,): STATIC,
        MOVING or BESIDE."""
        asked = self.all_verdicts != self.UNASKED
        return self.all_points[asked], np.array(self.numbers, np.uint8).take(self.scan[asked]), self.all_verdicts[asked]


NOTHING_JUDGED = Judged(np.zeros((0, 2)), np.zeros(0, np.int64), (), np.zeros(0, np.uint8))


class MapUpdate(msgspec.Struct, frozen=True, eq=False):
    """One cycle: where the car was at the newest scan, and the static detections (N, 2) in base that went into the map."""

    ego: EgoState
    static_points: Floats  # (N, 2) m, base frame at `ego.stamp_ns`
    judged: Judged = NOTHING_JUDGED  # all detections, those among them
    map_from_odom: SE2 | None = None  # by poses from outside, if there were any


class Mapper:
    """Remembers the poses, the scans of the running cycle, which radars are trusted, and the map.

    Time comes with the data: `update(now_ns)` ends the cycle as its `gathering` says, with the last scan that is due or by the receive time
    of the traffic. Every complete scan goes into exactly one cycle. Where the way of the car is lost a new map starts, with its own history
    and poses; `epoch` counts how often.
    """

    def __init__(
        self,
        mounts: Mapping[str, Mount],
        infer: Infer,
        occupancy: TiledMap,
        health: Health,
        noise: GateNoise,
        cycle_ns: int,
        max_age_ns: int,
        errors: ErrorFilter | None = None,
        frame: MapFrame | None = None,
    ) -> None:
        """`errors`: what is known of the motion sensors' errors, if anything is. `frame`: for poses from outside, if there are any."""
        self.mounts = mounts
        self.infer = infer
        self.map = occupancy
        self.health = health
        self.noise = noise
        self.max_age_ns = max_age_ns
        self.watch = Watch(mounts, health.sensors, noise)
        self.odometry = Odometry(ErrorFilter(tuple(mounts)) if errors is None else errors)
        self.frame = frame
        self.doppler = DopplerErrors()
        self.again = SeenAgain()
        self.history = History()
        self.pending: list[RadarScan] = []
        self._untaught: Sweep | None = None  # the newest, of which nothing was learned yet
        self.newest_ns: dict[str, int] = {}  # stamp of each sensor's newest scan
        self.gathering = Gathering(cycle_ns, max_age_ns)
        self.epoch = 0  # maps begun before this one
        self._in_view = list(in_view(mounts, occupancy.spec).values())
        self._in_view_of: dict[frozenset[int], NDArray[np.uint16]] = {}  # of those that came with one cycle
        self._numbers = {name: number for number, name in enumerate(mounts)}

    def keep(self, shelf: Shelf, epoch: int) -> None:
        """From the start on: where the map's tiles go that the memory has no room for, and the number that epochs begin with."""
        self.map.shelf, self.epoch = shelf, epoch

    def on_motion(self, motion: EgoMotion) -> None:
        """A sample that cannot be true is left out; one that does not continue those before begins a new map."""
        verdict = self.watch.motion.judge(motion)
        if verdict is not GOOD and verdict in NEW_MAP:
            self._start_new_map(f"ego motion: {verdict.value}", motion.stamp_ns)
            verdict = self.watch.motion.judge(motion)
        if verdict is GOOD:
            self.odometry.add(motion)
        elif verdict is IMPLAUSIBLE:
            self.health.motion_implausible += 1
        else:
            self.health.motion_dropped += 1

    def on_scan(self, scan: RadarScan) -> None:
        name, stamp_ns, newest_ns = scan.sensor, scan.stamp_ns, self.newest_ns
        sensor = self.health.sensors[name]
        if scan.received_ns - stamp_ns > self.max_age_ns or (name in newest_ns and stamp_ns <= newest_ns[name]):
            sensor.late += 1
            return
        newest_ns[name] = stamp_ns
        sensor.complete += 1
        self.watch.radars[name].hear(scan)
        self.health.detections += len(scan.range)
        self.gathering.hear(scan)
        self.pending.append(scan)

    def on_pose(self, fix: PoseFix) -> None:
        """Moves the frame that does not drift, at the end of the cycle; never the map."""
        if self.frame is not None:
            self.frame.add(fix)

    def take(self, item: RadarScan | EgoMotion | PoseFix, now_ns: int | None) -> Iterable[MapUpdate]:
        """What a frame says, and the map's states that come of it. Time passes before it is heard, to the time that the traffic then has,
        `now_ns`, or the scan's own: whether a cycle is over does not depend on other frames between. None: time stays."""
        if isinstance(item, RadarScan):
            return self._with_scan(item, item.received_ns if now_ns is None else now_ns)
        if now_ns is not None:
            return self._with_motion(item, now_ns)
        self._hear(item)
        return ()

    def _with_scan(self, scan: RadarScan, now_ns: int) -> Iterator[MapUpdate]:
        if (update := self.update(now_ns)) is not None:
            yield update
        self.on_scan(scan)
        if (update := self.update(scan.received_ns)) is not None:
            yield update

    def _with_motion(self, item: EgoMotion | PoseFix, now_ns: int) -> Iterator[MapUpdate]:
        if (update := self.update(now_ns)) is not None:
            yield update
        self._hear(item)

    def _hear(self, item: EgoMotion | PoseFix) -> None:
        if self._untaught is not None:
            self.learn()
        if isinstance(item, PoseFix):
            self.on_pose(item)
        else:
            self.on_motion(item)

    def span(self) -> tuple[int, int]:
        """ns: from when until before when `update` has nothing to do, but for a scan."""
        begin_ns = self.gathering.begin_ns
        return (EVER, EVER) if begin_ns is None else (begin_ns - BACK_NS, self.gathering.ask_ns)

    def update(self, now_ns: int) -> MapUpdate | None:
        """Ends the cycle if it is whole, or its time is up; the map's next state, or None where there was nothing to add."""
        if self._untaught is not None:
            self.learn()
        gathering = self.gathering
        begin_ns = gathering.begin_ns
        if begin_ns is not None and now_ns < begin_ns - BACK_NS:
            self._start_new_map("the clock was set back", now_ns)
        elif begin_ns is not None and (now_ns < gathering.settled_ns or not gathering.is_whole(now_ns, self._awaited())):
            return None
        gathering.end(now_ns, empty=not self.pending)
        return self.end_cycle()

    def end_cycle(self) -> MapUpdate | None:
        """Predict, doubt, gate, remember, infer, integrate: what the pending scans say goes into the map, if it takes any here.

        What they say of the motion sensors is learned behind that, before anything else is heard: the map need not wait for it."""
        self.learn()
        if self.frame is not None:
            self.frame.settle(self.odometry)
        sweep = self._trusted(self._place(self.pending))
        self.pending = []
        if sweep is None:
            return None
        self._untaught, ego = sweep, sweep.newest
        points, in_odom, origins, sensors = sweep.placed_at(ego.odom_from_base)  # moving ones too
        verdicts, (near, reached) = gated(points, sweep.sigmas, sweep.near, sweep.range, self.map.reach, self.noise)
        found = Detections(in_odom, origins, sweep.rcs, sweep.sigmas)
        numbers = [self._numbers[one.scan.sensor] for one in sweep.placed]
        self.health.cycles += 1
        self.health.static_detections += near.size
        view = self._view(numbers, ego.stamp_ns)
        takes = self.map.takes(ego.odom_from_base)
        if self.map.reach:
            self.map.measure(_beams(found, reached, sweep, numbers), ego.odom_from_base, view)
        if takes:
            looks = Looks(sensors, sweep.scans[:, Scan.HALF_FOV], sweep.scans[:, Scan.RANGE])
            self.history.add(found.taken(near), looks, self.odometry.distance)
            said = self.infer(self.history.surroundings(ego.odom_from_base, self._live(ego.stamp_ns)))
            self.map.integrate(said, ego.odom_from_base, view)
        self.health.tiles_forgotten = self.map.forgotten
        self.watch.mapped_ns = max([one.scan.received_ns for one in sweep.placed])
        map_from_odom = None if self.frame is None else self.frame.map_from_odom
        return MapUpdate(ego, points.take(near, axis=0), Judged(points, sweep.scan, numbers, verdicts), map_from_odom)

    def learn(self) -> None:
        """What the newest cycle says of the motion sensors, which otherwise waits for what is heard next: for the end of a drive."""
        if (sweep := self._untaught) is not None:
            self._untaught = None
            self.doppler.add(sweep.placed, self.odometry.errors, self.noise)
            self.again.add(sweep, self.odometry.errors, self.noise)

    def certainty(self, ego: EgoState) -> Certainty:
        """How well the car's motion is known at the newest pose."""
        return self.odometry.errors.certainty(ego.speed, ego.yaw_rate)

    def _start_new_map(self, why: str, begun_ns: int) -> None:
        """Another map: where the car is in the old one is not known any more."""
        self.map.clear(begun_ns)
        self.history = History()
        self.odometry.restart()
        if self.frame is not None:
            self.frame.restart()
        self.doppler.restart()
        self.again.restart()
        self.pending = []
        self.newest_ns.clear()
        self.gathering.restart()
        self.watch.restart(why)
        self.epoch += 1

    def _awaited(self) -> list[str]:
        """Radars whose scans a cycle waits for: those that are trusted."""
        return [name for name, radar in self.watch.radars.items() if not radar.doubts]

    def _place(self, scans: list[RadarScan]) -> list[PlacedScan]:
        """The scans with where the car was when each was measured; those without are counted."""
        egos = [self.odometry.at(scan.stamp_ns) for scan in scans]
        placed = [PlacedScan(scan, self.mounts[scan.sensor], ego) for scan, ego in zip(scans, egos, strict=True) if ego is not None]
        self.health.scans_without_pose += len(scans) - len(placed)
        return placed

    def _trusted(self, placed: list[PlacedScan]) -> Sweep | None:
        """Those of trusted radars; none while ego motion is not trusted, and what comes after that belongs to a new map."""
        if not placed:
            return None
        disputed = self.watch.motion.disputed
        sweep = Sweep.of(placed, self.noise)
        self.watch.judge(sweep)
        if self.watch.motion.disputed is not None:
            self.health.scans_without_pose += len(placed)
            return None
        if disputed is not None:
            self._start_new_map(f"ego motion was not trusted ({disputed})", sweep.newest.stamp_ns)
            return None
        trusted = [not self.watch.radars[one.scan.sensor].doubts for one in placed]
        for one, is_trusted in zip(placed, trusted, strict=True):
            self.health.sensors[one.scan.sensor].distrusted += not is_trusted
        return sweep.only(trusted, self.noise) if any(trusted) else None

    def _view(self, numbers: Sequence[int], stamp_ns: int) -> View:
        """Which of the radars with these numbers had which cells in view, as if from where the car is now: within a cycle it goes a few
        cells at most."""
        seen_by = frozenset(numbers)
        if seen_by not in self._in_view_of:
            self._in_view_of[seen_by] = np.bitwise_or.reduce([self._in_view[number] for number in seen_by])
        return View(stamp_ns, self._in_view_of[seen_by])

    def _live(self, now_ns: int) -> list[str]:
        """Trusted radars with a scan that is not older than `max_age_ns`."""
        oldest_ns, radars = now_ns - self.max_age_ns, self.watch.radars
        return [name for name, stamp_ns in self.newest_ns.items() if stamp_ns >= oldest_ns and not radars[name].doubts]


def _beams(found: Detections, static: NDArray[np.int64], sweep: Sweep, numbers: Sequence[int]) -> Beams:
    """The static detections, as far as the map reaches, which may be farther than a network is shown. `numbers` (S,) of the radars."""
    bits = np.array([1 << number for number in numbers], np.uint16)
    return Beams(found.points.take(static, axis=0), found.origins.take(static, axis=0), bits.take(sweep.scan.take(static)))


def in_view(mounts: Mapping[str, Mount], spec: GridSpec) -> dict[str, NDArray[np.uint16]]:
    """For each radar its bit, 1 << i for the i-th one, (H, W) on those cells of the patch whose centre lies in its field of view."""
    centres = spec.centres()
    return {name: np.where(mount.sees(centres), 1 << bit, 0).astype(np.uint16) for bit, (name, mount) in enumerate(mounts.items())}
