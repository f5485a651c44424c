"""What of a lidar's truth to distrust: its clock, its place on the car, and how little the car moved.

The clock is found by sharpness: turns that are placed at the right moment put what stands into the fewest cells.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echogrid.config.tables import Config
from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState
from echogrid_training.labelling.lidar_mount import LidarMount, base_from_lidar
from echogrid_training.labelling.lidar_truth import Placed, Where
from echogrid_training.labelling.lidar_turn import standing

ASKED = 80  # turns that sharpness is tried on
DELAYS_MS = np.arange(-200.0, 201.0, 20.0)
SPAN, STRAIGHT, TURNED, LEAST_SPANS = 1.0, math.radians(16.0), 0.8, 3  # m, rad, degrees, and how many of them
FINE, NEAR = 0.1, 20.0  # m: cells that are counted, and how far from the lidar
CLEARLY = 0.01  # of the cells: what a better place has to save to be believed
TURNING = math.radians(8.0)  # rad/s from which a delay shows
LEVEL, TILT = 0.12, 1.0  # m and degrees that the ground may be off
AHEAD, LOW = (5.0, 12.0), 0.6  # m from the lidar, and about the height 0: where the ground is looked for
STANDING, MOST_STANDING = 0.1, 0.5  # m/s, and the share of turns that may be slower
LEAST_TURNS = 50


@dataclass(frozen=True, slots=True)
class Doubt:
    """One thing to distrust, or that could not be told. `code` is stable."""

    code: str
    sentence: str


def doubts(turns: Sequence[Placed], missed: int, where: Where, mount: LidarMount, config: Config, *, level: bool) -> list[Doubt]:
    """`missed`: turns without a pose; `where`: poses at other times; `level`: the ground is taken to be. At least one turn."""
    found = []
    if missed:
        found.append(Doubt("no-pose", f"{missed} of {missed + len(turns)} turns lie where no pose is known; they are left out"))
    if len(turns) < LEAST_TURNS:
        found.append(Doubt("few-turns", f"{len(turns)} turns, expected {LEAST_TURNS} and more: little is seen from several places"))
    slow = float(np.mean([abs(turn.ego.speed) < STANDING for turn in turns]))
    if slow > MOST_STANDING:
        found.append(Doubt("standing", f"the car stands in {slow:.0%} of the turns: what it sees from there counts as often, errors too"))
    if level:
        found += _ground(turns, mount)
    found += _delay(turns, where, mount, config)
    found += _yaw(turns)
    return found


def _ground(turns: Sequence[Placed], mount: LidarMount) -> list[Doubt]:
    """A plane through what should be ground: its height under the car, and its tilt."""
    pose, parts = base_from_lidar(mount), [np.empty((0, 3))]
    for turn in _some(turns, ASKED // 4):
        points = turn.points.astype(float)
        away = np.hypot(points[:, 0] - pose.place[0], points[:, 1] - pose.place[1])
        parts.append(points[(away > AHEAD[0]) & (away < AHEAD[1]) & (np.abs(points[:, 2]) < LOW)][::7])
    points = np.concatenate(parts)
    if len(points) < 100:
        return [
            Doubt("no-ground", f"no ground within {AHEAD[1]:g} m at the height of the wheels: z, pitch or roll of the lidar is far off")
        ]
    kept = np.ones(len(points), bool)
    plane = np.zeros(3)
    for _ in range(5):  # kerbs and lower edges fall out
        system = np.column_stack((points[kept, :2], np.ones(int(kept.sum()))))
        plane, *_rest = np.linalg.lstsq(system, points[kept, 2], rcond=None)
        off = np.abs(points[:, 2] - points[:, :2] @ plane[:2] - plane[2])
        kept = off < max(0.05, 1.5 * float(np.median(off[kept])))
    out = []
    if abs(plane[2]) > LEVEL:
        out.append(Doubt("height", f"the ground lies at {plane[2]:+.2f} m: z = {mount.z - plane[2]:.2f} would put it at 0"))
    pitch, roll = math.degrees(math.atan(plane[0])), math.degrees(math.atan(plane[1]))
    if max(abs(pitch), abs(roll)) > TILT:
        out.append(
            Doubt("tilt", f"the ground rises by {pitch:+.1f}° ahead and {roll:+.1f}° to the left: pitch or roll of the lidar, or a slope")
        )
    return out


def _delay(turns: Sequence[Placed], where: Where, mount: LidarMount, config: Config) -> list[Doubt]:
    turning = [turn for turn in turns if abs(turn.ego.yaw_rate) > TURNING]
    if len(turning) < 10:
        return [Doubt("clock-unknown", "the car hardly turned, so a wrong clock between lidar and CAN would not show")]
    some, place = _some(turning, ASKED), base_from_lidar(mount).place[:2]
    counts = []
    for delay in DELAYS_MS:
        stamps = np.array([turn.stamp_ns - round(delay * 1e6) for turn in some], np.int64)
        counts.append(_cells(some, where(stamps), place, config))
    best = int(np.argmin(counts))
    if counts[best] < (1 - CLEARLY) * counts[len(counts) // 2] and abs(DELAYS_MS[best]) > 20:
        return [
            Doubt("clock", f"its clock is {DELAYS_MS[best]:+.0f} ms off the CAN log's: latency_ms = {mount.latency_ms + DELAYS_MS[best]:g}")
        ]
    return []


def _yaw(turns: Sequence[Placed]) -> list[Doubt]:
    """A rear axle goes where it points: laid on walls, a lidar that is turned seems to go sideways."""
    off, begin = [], 0
    for number, turn in enumerate(turns):
        way = turns[begin].odom_from_base.inverse() @ turn.odom_from_base
        if math.hypot(way.x, way.y) < SPAN:
            continue
        if abs(way.yaw) < STRAIGHT and way.x > 0:
            off.append(math.degrees(math.atan2(way.y, way.x) - way.yaw / 2))
        begin = number
    if len(off) < LEAST_SPANS:
        return [Doubt("yaw-unknown", "the car hardly went straight on, so a wrong heading of the lidar would not show")]
    yaw = -float(np.median(off))
    if abs(yaw) < TURNED:
        return []
    return [Doubt("yaw", f"the lidar is turned by {yaw:+.1f}° against what is said, or the car goes sideways")]


def _cells(turns: Sequence[Placed], poses: Sequence[EgoState | None], place: Floats, config: Config) -> float:
    """Cells of FINE m that hold what stands near, of every turn that has a pose; per turn. `place` (2,) m of the lidar in base."""
    cells, used = [np.empty(0, np.int64)], 0
    for turn, ego in zip(turns, poses, strict=True):
        if ego is None:
            continue
        used += 1
        points = turn.points[::5].astype(float)
        points = points[standing(points, turn.height[::5].astype(float), config.body)]
        near = points[np.hypot(*(points[:, :2] - place).T) < NEAR]
        cell = np.floor(ego.odom_from_base.apply(near[:, :2]) / FINE).astype(np.int64)
        cells.append(cell[:, 0] * 1_000_003 + cell[:, 1])
    return len(np.unique(np.concatenate(cells))) / max(used, 1)


def _some(turns: Sequence[Placed], most: int) -> list[Placed]:
    """Runs of neighbours, evenly spread: what is sharp shows where turns overlap."""
    if len(turns) <= most:
        return list(turns)
    first = np.linspace(0, len(turns) - most // 4, 4).astype(int)
    return [turns[index] for begin in first for index in range(begin, begin + most // 4)]
