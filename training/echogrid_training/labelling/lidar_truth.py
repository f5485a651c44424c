"""The true map out of a real lidar: every turn placed where the car was, laid on those before it, and summed (the paper's Eq. 1)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from echogrid.config.tables import Config
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.odometry import EgoState, Odometry
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid_training.evaluation.recorded.drive import RealDrive
from echogrid_training.labelling.clouds import Cloud
from echogrid_training.labelling.ground import Heights
from echogrid_training.labelling.lidar_mount import LidarMount, base_from_lidar
from echogrid_training.labelling.lidar_turn import MOVER, Reduced, reduce, standing
from echogrid_training.labelling.matching import Matcher
from echogrid_training.realism.figures import residual_of
from echogrid_training.recording import Stamps
from echogrid_training.truth.ground_truth import TruthBuilder, TruthMap

KEPT = 5  # of the turns, every so many is kept with the truth
MOVING, FAR = 1.5, 25.0  # m/s off a standing thing's range rate, and m: what a detection has to show to be a mover
Where = Callable[[Stamps], list[EgoState | None]]  # by stamps, in any order
LONG = 1e9  # s: no state is forgotten
AROUND_NS = 100_000_000  # between a turn and the detections that say what moves in it


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A turn, where base was, and what moved."""

    stamp_ns: int
    points: NDArray[np.float32]  # (N, 3) m in base
    height: NDArray[np.float32]  # (N,) m above the ground
    ego: EgoState  # by dead reckoning, or by the poses that were brought
    moving: Floats  # (M, 2) m in base
    odom_from_base: SE2  # laid on the turns before


def placed(
    drive: RealDrive, config: Config, clouds: Iterable[Cloud], mount: LidarMount, where: Where, heights: Heights
) -> tuple[list[Placed], int]:
    """The turns, given in order of time, that have a pose, and how many have none."""
    latency = round(mount.latency_ms * 1e6)
    motion = reckoning(drive)
    found, at_ns = movers(drive, {radar.name: radar.mount() for radar in config.radar})
    out, pose, matcher, missed = list[Placed](), base_from_lidar(mount), Matcher(), 0
    for cloud in clouds:
        stamp_ns = cloud.stamp_ns - latency
        (ego,), (reckoned,) = where(np.array([stamp_ns])), motion(np.array([stamp_ns]))
        if ego is None:
            missed += 1
            continue
        near = np.abs(at_ns - stamp_ns) <= AROUND_NS
        moving = np.empty((0, 2)) if reckoned is None else reckoned.odom_from_base.inverse().apply(agreed(found[near]))
        points = pose.apply(cloud.points)
        height = heights(points, pose.place)
        laid = matcher.lay(ego.odom_from_base, laid_by(points, height, moving, config))
        out.append(Placed(stamp_ns, points.astype(np.float32), height.astype(np.float32), ego, moving, laid))
    return out, missed


def laid_by(points: Floats, height: Floats, moving: Floats, config: Config) -> Floats:
    """(N, 2) m in base: returns of what stands."""
    flat = points[standing(points, height, config.body)][:, :2]
    if len(moving):
        flat = flat[(np.hypot(*(flat[:, None] - moving).transpose(2, 0, 1)) > MOVER).all(axis=1)]
    return flat


def reckoning(drive: RealDrive) -> Where:
    """The service's dead reckoning of a whole drive; None where it has no pose."""
    odometry = Odometry(history=LONG)
    for _, item in drive.items:
        if not isinstance(item, RadarScan):
            odometry.add(item)
    return lambda stamps: [odometry.at(stamp_ns) for stamp_ns in stamps.tolist()]


def movers(drive: RealDrive, mounts: dict[str, Mount]) -> tuple[Floats, Stamps]:
    """Detections that move, (M, 2) m in odom, and when each was measured."""
    places, stamps = [np.empty((0, 2))], [np.empty(0, np.int64)]
    for scan, ego in drive.scans:
        mount = mounts[scan.sensor]
        off = np.abs(residual_of(scan, mount, ego.speed, ego.yaw_rate))
        chosen: NDArray[np.bool_] = (off > MOVING) & (scan.range < FAR)
        points = np.stack((scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)), axis=-1)[chosen]
        places.append((ego.odom_from_base @ mount.base_from_sensor).apply(points))
        stamps.append(np.full(len(points), scan.stamp_ns))
    return np.concatenate(places), np.concatenate(stamps)


def agreed(moving: Floats) -> Floats:
    """Of detections that move, (M, 2) m, those that another one is near: a single one is mostly a wrong Doppler."""
    if len(moving) < 2:
        return moving[:0]
    distance, _ = cKDTree(moving).query(moving, 2)
    kept: Floats = moving[distance[:, 1] < MOVER]
    return kept


def reduced(turn: Placed, place: Floats, config: Config) -> Reduced:
    """`place` (2,) m of the lidar in base."""
    moving = turn.odom_from_base.apply(turn.moving)
    points = turn.points.astype(float)
    return reduce(points, turn.height.astype(float), place, turn.odom_from_base, config.body, moving)


def way(turns: Sequence[Placed]) -> tuple[Stamps, Floats]:
    """Stamps (N,) and poses (N, 3) of base in odom: x, y (m), yaw (rad, continuous)."""
    poses = np.array([(one.odom_from_base.x, one.odom_from_base.y, one.odom_from_base.yaw) for one in turns]).reshape(-1, 3)
    poses[:, 2] = np.unwrap(poses[:, 2])
    return np.array([one.stamp_ns for one in turns], np.int64), poses


def build(turns: Iterable[Placed], driven: Floats, mount: LidarMount, config: Config) -> tuple[TruthMap, Stamps, Floats]:
    """The map, and of every KEPT-th turn the stamp and the ranges (K, AZIMUTHS). `driven` (N, 2) m: where base was."""
    place = base_from_lidar(mount).place[:2]
    arm = np.hypot(*place)
    builder = TruthBuilder(driven.min(axis=0) - arm, driven.max(axis=0) + arm, config.grid.cell)
    stamps, ranges = [], []
    for number, turn in enumerate(turns):
        one = reduced(turn, place, config)
        builder.add(one.origin, one.ranges, one.excluded)
        if number % KEPT == 0:
            stamps.append(turn.stamp_ns)
            ranges.append(np.where(one.excluded, np.inf, one.ranges))
    return builder.finish(), np.array(stamps, np.int64), np.array(ranges)
