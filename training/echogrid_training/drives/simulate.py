"""A whole drive through a town: what its four radars and its motion sensors report, where it truly was, and the true map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid_training.recording import EPOCH_NS, LidarTurns, Recording, Truth, untracked
from echogrid_training.recording import Track as Progress
from echogrid_training.sensors import lidar
from echogrid_training.sensors.density import Station, sensitivity_for
from echogrid_training.sensors.episode import Corner, Episode
from echogrid_training.sensors.motion_model import sense_motion
from echogrid_training.sensors.radar_model import Sensitivity, Sensor, Surroundings, sense, sensor_at
from echogrid_training.sensors.visibility import Near, Traffic, poses_at
from echogrid_training.towns.town import Thing, Town, Track, observed_by_car
from echogrid_training.truth.ground_truth import TruthBuilder, TruthMap

STATIONS = 8  # moments per radar at which the density is measured before the drive


def simulate(town: Town, episode: Episode, track: Progress = untracked) -> tuple[Recording, TruthMap]:
    """The drive of an episode through a town, both in the frame of the first pose. The same town and episode give the same bits."""
    town = from_first_pose(town)
    surroundings = Surroundings(town, episode.radar.max_range)
    sensitivity = sensitivity_for(surroundings, _stations(town, episode), episode)
    scans: list[RadarScan] = []
    for number, corner in enumerate(episode.corners):
        scans += radar_scans(town, surroundings, corner, episode, sensitivity, _rng(town, episode, number), track)
    turns = list(lidar_turns(town, track))
    ego = town.ego
    truth = Truth(EPOCH_NS + np.round(ego.time * 1e9).astype(np.int64), ego.x, ego.y, ego.yaw, _walls(town.things))
    recording = Recording(
        vehicle=town.name,
        body=episode.body,
        radars=tuple(corner.mount for corner in episode.corners),
        scans=sorted(scans, key=lambda scan: scan.stamp_ns),
        motion=sense_motion(ego, episode.motion, _rng(town, episode, len(episode.corners))),
        truth=truth,
        lidar=LidarTurns(np.array([_stamp_ns(turn.time) for turn in turns]), np.array([turn.ranges for turn in turns])),
    )
    return recording, truth_map(turns)


def radar_scans(
    town: Town,
    surroundings: Surroundings,
    corner: Corner,
    episode: Episode,
    sensitivity: Sensitivity,
    rng: np.random.Generator,
    track: Progress = untracked,
) -> list[RadarScan]:
    """All scans of one radar that are not lost."""
    times = scan_times(town.ego, corner, episode, rng)
    sensors = _sensors(town.ego, corner, times)
    traffic = Traffic(town.movers, times)
    scans = []
    for step in track(range(len(times)), f"sensing {corner.mount.name}"):
        if rng.uniform() < episode.dropped:
            continue
        stamp_ns = EPOCH_NS + round(float(times[step]) * 1e9)
        scans.append(sense(surroundings, traffic.at(step), sensors[step], corner, episode, sensitivity, rng, stamp_ns))
    return scans


def scan_times(ego: Track, corner: Corner, episode: Episode, rng: np.random.Generator) -> Floats:
    """(T,) s within the drive, when the radar measures and is not lost."""
    begin, end = float(ego.time[0]), float(ego.time[-1])
    radar = episode.radar
    times = np.arange(begin + corner.phase * radar.cycle, end - radar.jitter, radar.cycle)
    times = times + rng.uniform(0.0, radar.jitter, len(times))
    lost_from, lost_until = (begin + share * (end - begin) for share in corner.lost)
    return times[(times < lost_from) | (times >= lost_until)]


@dataclass(frozen=True, slots=True, eq=False)
class ReducedTurn:
    """One turn of the lidar at `time` (s): its place (2,) m, and by bearing (AZIMUTHS,) the nearest return in m and whether it moves."""

    time: float
    origin: Floats
    ranges: Floats
    moving: NDArray[np.bool_]


def lidar_turns(town: Town, track: Progress = untracked) -> Iterator[ReducedTurn]:
    """The drive's turns, RATE a second."""
    view = LidarView(town, np.arange(town.ego.time[0], town.ego.time[-1], 1.0 / lidar.RATE))
    for step in track(range(len(view.times)), "turning the lidar"):
        points, standing = view.turn(step)
        ranges, surface = lidar.reduce(points)
        yield ReducedTurn(float(view.times[step]), view.origins[step], ranges, surface >= standing)


class LidarView:
    """What is around the lidar at given times (T,) s: `origins` (T, 2) m are its places."""

    def __init__(self, town: Town, times: Floats) -> None:
        self.times = times
        self._standing = _surfaces([thing for thing in town.things if thing.top > lidar.GROUND])
        self._near = Near(self._standing.segments, lidar.MAX_RANGE)
        self._traffic = Traffic(town.movers, times)
        self._heights = np.array([mover.height for mover in town.movers])
        ego, arm = poses_at(town.ego, times), lidar.BASE_FROM_LIDAR
        self.origins = np.stack((ego.x + arm.x * np.cos(ego.yaw), ego.y + arm.x * np.sin(ego.yaw)), axis=-1)

    def turn(self, step: int) -> tuple[lidar.Turn, int]:
        """The returns of one turn, and the number of surfaces that stand: those of movers come after them."""
        present = self._traffic.at(step)
        boxes = present.segments()
        moving = lidar.Surfaces(boxes, np.zeros(len(boxes)), np.repeat(self._heights[present.mover], 4))
        around = self._standing.pick(self._near(self.origins[step]))
        return lidar.turn(around + moving, self.origins[step]), len(around.segments)

    def points(self, step: int) -> Floats:
        """(N, 2) m: all returns of one turn that are neither ground nor overhead."""
        found, _ = self.turn(step)
        standing = np.isfinite(found.distance) & (found.height > lidar.GROUND) & (found.height < lidar.ROOF)
        bearing, distance = np.broadcast_to(lidar.bearings()[:, None], standing.shape)[standing], found.distance[standing]
        points: Floats = np.stack((distance * np.cos(bearing), distance * np.sin(bearing)), axis=-1) + self.origins[step]
        return points


def truth_map(turns: Sequence[ReducedTurn]) -> TruthMap:
    """What the lidar says along the true path, movers excluded."""
    origins = np.array([turn.origin for turn in turns])
    builder = TruthBuilder(origins.min(axis=0), origins.max(axis=0))
    for turn in turns:
        builder.add(turn.origin, turn.ranges, turn.moving)
    return builder.finish()


def from_first_pose(town: Town) -> Town:
    """The town in the frame of the ego's first pose, which is then (0, 0, 0)."""
    town_from_start = SE2(float(town.ego.x[0]), float(town.ego.y[0]), float(town.ego.yaw[0]))
    start_from_town = town_from_start.inverse()

    def moved(track: Track) -> Track:
        places = start_from_town.apply(np.stack((track.x, track.y), axis=-1))
        return replace(track, x=places[:, 0], y=places[:, 1], yaw=track.yaw - town_from_start.yaw)

    return replace(
        town,
        things=tuple(replace(thing, outline=start_from_town.apply(thing.outline)) for thing in town.things),
        roads=tuple(replace(road, line=start_from_town.apply(road.line)) for road in town.roads),
        movers=tuple(replace(mover, track=moved(mover.track)) for mover in town.movers),
        ego=moved(town.ego),
    )


def _sensors(ego: Track, corner: Corner, times: Floats) -> list[Sensor]:
    poses = poses_at(ego, times)
    columns = zip(poses.x, poses.y, poses.yaw, poses.speed, poses.yaw_rate, strict=True)
    return [
        sensor_at(SE2(float(x), float(y), float(yaw)), corner.mount.base_from_sensor, float(speed), float(yaw_rate))
        for x, y, yaw, speed, yaw_rate in columns
    ]


def _stations(town: Town, episode: Episode) -> list[Station]:
    times = np.linspace(town.ego.time[0], town.ego.time[-1], STATIONS + 2)[1:-1]
    traffic = Traffic(town.movers, times)
    present = [traffic.at(step) for step in range(STATIONS)]
    return [
        Station(corner, sensor, there)
        for corner in episode.corners
        for sensor, there in zip(_sensors(town.ego, corner, times), present, strict=True)
    ]


def _surfaces(things: Sequence[Thing]) -> lidar.Surfaces:
    sides = [thing.segments() for thing in things]
    counts = [len(side) for side in sides]
    bottom, top = np.array([thing.bottom for thing in things]), np.array([thing.top for thing in things])
    return lidar.Surfaces(np.concatenate([np.zeros((0, 2, 2)), *sides]), np.repeat(bottom, counts), np.repeat(top, counts))


def _walls(things: Sequence[Thing]) -> Floats:
    return np.concatenate([np.zeros((0, 2, 2)), *(thing.segments() for thing in things if observed_by_car(thing.material))])


def _stamp_ns(time: float) -> int:
    return EPOCH_NS + round(time * 1e9)


def _rng(town: Town, episode: Episode, stream: int) -> np.random.Generator:
    return np.random.default_rng((episode.seed, town.seed, stream))
