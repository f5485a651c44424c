"""A small generated world for demonstrations and tests: walls, cars and poles, other traffic, and a car with four corner radars in it.

It is plane geometry with noise: what a radar sees is the first surface along each ray. There is no multipath, no antenna and no material.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from echogrid.config.tables import Body
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2, arc
from echogrid_training.driving.path import Path
from echogrid_training.recording import EPOCH_NS, Motion, RadarMount, Recording, Track, truth_from, untracked

BODY = Body(length=4.5, width=1.8, rear_overhang=0.9)
FOV = math.radians(150.0)
CORNERS = (
    RadarMount("front_left", SE2(3.5, 0.8, math.radians(45.0)), FOV),
    RadarMount("front_right", SE2(3.5, -0.8, math.radians(-45.0)), FOV),
    RadarMount("rear_left", SE2(-0.8, 0.8, math.radians(135.0)), FOV),
    RadarMount("rear_right", SE2(-0.8, -0.8, math.radians(-135.0)), FOV),
)
PHASES_MS = (0, 13, 27, 39)  # of the radars' cycles, which are not in step
CYCLE_MS, MOTION_MS = 50, 10
MAX_RANGE = 40.0  # m
RAYS = 120  # cast per scan, of which some give a detection
DETECTIONS = (15, 35)  # fewest and most per scan, clutter included
TRACK, WHEELBASE = 1.55, 2.7  # m


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle of `length` along its x axis and `width` across, by the pose of its centre: a parked car, a pole."""

    world_from_box: SE2
    length: float = 4.5
    width: float = 1.8

    def segments(self) -> Floats:
        """Its four sides (4, 2, 2) in the world."""
        x, y = self.length / 2, self.width / 2
        corners = self.world_from_box.apply(np.array(((x, y), (-x, y), (-x, -y), (x, -y))))
        return np.stack((corners, np.roll(corners, -1, axis=0)), axis=1)


def pole(x: float, y: float) -> Box:
    """A lamp post at (x, y) m."""
    return Box(SE2(x, y, 0.0), 0.2, 0.2)


@dataclass(frozen=True, slots=True)
class Mover:
    """A car that drives on with constant speed (m/s) and yaw rate (rad/s) from where it is at time 0; its poses are those of its centre."""

    start: SE2
    speed: float
    yaw_rate: float = 0.0
    length: float = 4.5
    width: float = 1.8

    def box(self, time: float) -> Box:
        return Box(self.start @ arc(self.speed * time, self.yaw_rate * time), self.length, self.width)

    def velocity(self, points: Floats, time: float) -> Floats:
        """Of the car's points that are at these places (N, 2) at that time: (N, 2) m/s in the world."""
        pose = self.box(time).world_from_box
        turn = self.yaw_rate * (points - (pose.x, pose.y))
        return np.stack((self.speed * math.cos(pose.yaw) - turn[:, 1], self.speed * math.sin(pose.yaw) + turn[:, 0]), axis=-1)


@dataclass(frozen=True, eq=False)  # no slots: what stands is worked out once
class Scene:
    """Walls as segments (W, 2, 2) in m, standing boxes, and movers."""

    walls: ArrayLike = ()
    cars: Sequence[Box] = ()
    movers: Sequence[Mover] = ()

    @cached_property
    def standing(self) -> Floats:
        """(S, 2, 2) m: all that stands."""
        walls = np.array(self.walls, dtype=np.float64).reshape(-1, 2, 2)
        return np.concatenate((walls, *(car.segments() for car in self.cars)))


@dataclass(frozen=True, slots=True)
class Noise:
    """One-sigma errors of a detection and of the motion sensors (SI); `clutter`: detections of nothing, at most that many per scan."""

    range: float = 0.05
    azimuth: float = math.radians(1.0)
    range_rate: float = 0.1
    wheel_speed: float = 0.01
    yaw_rate: float = 0.002
    clutter: int = 2


USUAL = Noise()
NONE = Noise(0.0, 0.0, 0.0, 0.0, 0.0, clutter=0)


def cast(segments: Floats, origin: Floats, bearings: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """The distance (N,) m from `origin` to the first of the segments (S, 2, 2) along each bearing (N,) rad, inf if none, and its index."""
    if not len(segments):
        return np.full(len(bearings), np.inf), np.zeros(len(bearings), dtype=np.intp)
    rays = np.stack((np.cos(bearings), np.sin(bearings)), axis=-1)[:, None]  # (N, 1, 2)
    along = (segments[:, 1] - segments[:, 0])[None]  # (1, S, 2)
    gap = (segments[:, 0] - origin)[None]
    with np.errstate(divide="ignore", invalid="ignore"):  # a ray along a segment does not hit it
        turn = _cross(rays, along)
        distance = _cross(gap, along) / turn
        share = _cross(gap, rays) / turn
    hit = (distance > 0) & (share >= 0) & (share <= 1)
    distance = np.where(hit, distance, np.inf)
    first = distance.argmin(axis=1)
    return distance[np.arange(len(bearings)), first], first


def _near(segments: Floats, origin: Floats) -> Floats:
    """Those of the segments that may reach into MAX_RANGE."""
    middle, half = segments.mean(axis=1), np.hypot(*(segments[:, 1] - segments[:, 0]).T) / 2
    reached: NDArray[np.bool_] = np.hypot(*(middle - origin).T) - half < MAX_RANGE
    return segments[reached]


def _cross(a: Floats, b: Floats) -> Floats:
    product: Floats = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def scan(scene: Scene, path: Path, radar: RadarMount, time: float, rng: np.random.Generator, noise: Noise = USUAL) -> RadarScan:
    """What the radar measures at `time` (s); stamped EPOCH_NS later."""
    world_from_base = path.pose(time)
    world_from_sensor = world_from_base @ radar.base_from_sensor
    origin = np.array((world_from_sensor.x, world_from_sensor.y))
    standing = _near(scene.standing, origin)
    segments = np.concatenate((standing, *(mover.box(time).segments() for mover in scene.movers)))
    azimuth = rng.uniform(-radar.fov / 2, radar.fov / 2, RAYS)
    distance, first = cast(segments, origin, azimuth + world_from_sensor.yaw)
    seen = np.flatnonzero(distance < MAX_RANGE)[: rng.integers(DETECTIONS[0], DETECTIONS[1] - noise.clutter + 1)]
    azimuth, distance, first = azimuth[seen], distance[seen], first[seen]
    rays = np.stack((np.cos(azimuth + world_from_sensor.yaw), np.sin(azimuth + world_from_sensor.yaw)), axis=-1)

    velocity = np.zeros((len(seen), 2))  # of the surfaces that were hit
    for index, mover in enumerate(scene.movers):
        its = (first - len(standing)) // 4 == index
        velocity[its] = mover.velocity(origin + distance[its, None] * rays[its], time)
    speed, yaw_rate = (float(value[0]) for value in path.motion(np.array([time])))
    arm = origin - (world_from_base.x, world_from_base.y)
    own = (speed * math.cos(world_from_base.yaw) - yaw_rate * arm[1], speed * math.sin(world_from_base.yaw) + yaw_rate * arm[0])
    range_rate = ((velocity - own) * rays).sum(axis=1)

    clutter = int(rng.integers(0, noise.clutter + 1))
    stamp_ns = EPOCH_NS + round(time * 1e9)
    return RadarScan(
        radar.name,
        stamp_ns,
        stamp_ns,
        range=np.concatenate((np.abs(distance + rng.normal(0, noise.range, len(seen))), rng.uniform(2.0, MAX_RANGE, clutter))),
        azimuth=np.concatenate((azimuth + rng.normal(0, noise.azimuth, len(seen)), rng.uniform(-radar.fov / 2, radar.fov / 2, clutter))),
        range_rate=np.concatenate((range_rate + rng.normal(0, noise.range_rate, len(seen)), rng.uniform(-10.0, 10.0, clutter))),
        rcs=rng.normal(-12.0, 6.0, len(seen) + clutter),
    )


def wheel_speeds(speed: Floats, yaw_rate: Floats) -> Floats:
    """(N, 4) m/s, rear left, rear right, front left, front right: each wheel's own speed over ground when base moves so."""
    left, right, forward = speed - yaw_rate * TRACK / 2, speed + yaw_rate * TRACK / 2, yaw_rate * WHEELBASE
    return np.stack((left, right, np.hypot(left, forward), np.hypot(right, forward)), axis=-1)


def drive(
    scene: Scene,
    path: Path,
    seed: int,
    radars: Sequence[RadarMount] = CORNERS,
    noise: Noise = USUAL,
    track: Track = untracked,
) -> Recording:
    """A drive along the path, forward only. The same seed gives the same recording."""
    rng = np.random.default_rng(seed)
    duration_ms = int(1000 * path.duration)
    scans = [
        scan(scene, path, radar, time_ms / 1000, rng, noise)
        for radar, phase_ms in zip(radars, PHASES_MS, strict=False)
        for time_ms in track(range(phase_ms, duration_ms, CYCLE_MS), f"sensing {radar.name}")
    ]
    times_ms = np.arange(0, duration_ms, MOTION_MS)
    speed, yaw_rate = path.motion(times_ms / 1000)
    wheels = wheel_speeds(speed, yaw_rate)
    turning = wheels > 0  # standing wheels make no noise
    wheels = np.where(turning, np.abs(wheels + rng.normal(0, noise.wheel_speed, wheels.shape)), 0.0)
    stamps_ns = EPOCH_NS + times_ms * 1_000_000
    poses = [path.pose(time_ms / 1000) for time_ms in times_ms.tolist()]
    x, y, yaw = np.array([(pose.x, pose.y, pose.yaw) for pose in poses]).T
    return Recording(
        vehicle="scene",
        body=BODY,
        radars=tuple(radars),
        scans=scans,
        motion=Motion(stamps_ns, wheels, stamps_ns, yaw_rate + rng.normal(0, noise.yaw_rate, len(yaw_rate))),
        truth=truth_from(stamps_ns, x, y, yaw, scene.standing),
    )
