"""The true map out of a real lidar: every turn placed by dead reckoning, laid on those before it, and summed (the paper's Eq. 1)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.config.tables import Config
from echogrid.core.messages import EgoMotion, Floats, RadarScan
from echogrid.core.motion.odometry import EgoState, Odometry
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid_training.evaluation.recorded.drive import RealDrive
from echogrid_training.labelling.clouds import Cloud
from echogrid_training.labelling.lidar_mount import LidarMount, Pose3, base_from_lidar
from echogrid_training.labelling.lidar_turn import MOVER, Reduced, reduce, standing
from echogrid_training.labelling.matching import Matcher
from echogrid_training.realism.figures import residual_of
from echogrid_training.recording import Stamps
from echogrid_training.truth.ground_truth import TruthBuilder, TruthMap

KEPT = 5  # of the turns, every so many is kept with the truth
MOVING, FAR = 1.5, 25.0  # m/s off a standing thing's range rate, and m: what a detection has to show to be a mover
AROUND_NS = 100_000_000  # between a turn and the detections that say what moves in it


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A turn, where base was, and what moved."""

    cloud: Cloud
    ego: EgoState  # by dead reckoning
    moving: Floats  # (M, 2) m in base
    odom_from_base: SE2  # laid on the turns before


def placed(drive: RealDrive, config: Config, clouds: Iterable[Cloud], mount: LidarMount) -> tuple[list[Placed], int]:
    """The turns that dead reckoning has a pose for, in order of time, and how many it has none for."""
    latency = round(mount.latency_ms * 1e6)
    wanted = sorted((Cloud(one.stamp_ns - latency, one.points) for one in clouds), key=lambda one: one.stamp_ns)
    stamps = np.array([one.stamp_ns for one in wanted], np.int64)
    poses = poses_at([item for _, item in drive.items if not isinstance(item, RadarScan)], stamps)
    found, at_ns = movers(drive, {radar.name: radar.mount() for radar in config.radar})
    out, pose, matcher = [], base_from_lidar(mount), Matcher()
    for cloud, ego in zip(wanted, poses, strict=True):
        if ego is not None:
            near = np.abs(at_ns - cloud.stamp_ns) <= AROUND_NS
            moving = ego.odom_from_base.inverse().apply(found[near])
            out.append(Placed(cloud, ego, moving, matcher.lay(ego.odom_from_base, laid_by(cloud, pose, moving, config))))
    return out, len(wanted) - len(out)


def laid_by(cloud: Cloud, pose: Pose3, moving: Floats, config: Config) -> Floats:
    """(N, 2) m in base: returns of what stands."""
    points = pose.apply(cloud.points)
    flat = points[standing(points, config.body)][:, :2]
    if len(moving):
        flat = flat[(np.hypot(*(flat[:, None] - moving).transpose(2, 0, 1)) > MOVER).all(axis=1)]
    return flat


def poses_at(motion: list[EgoMotion], stamps: Stamps) -> list[EgoState | None]:
    """By the service's dead reckoning, at rising stamps; None where it has none."""
    odometry, out = Odometry(), list[EgoState | None]()
    for sample in motion:
        odometry.add(sample)
        while odometry.states and len(out) < len(stamps) and stamps[len(out)] <= odometry.states[-1].stamp_ns:
            out.append(odometry.at(int(stamps[len(out)])))
    return out + [None] * (len(stamps) - len(out))


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


def reduced(turn: Placed, pose: Pose3, config: Config) -> Reduced:
    return reduce(turn.cloud.points, pose, turn.odom_from_base, config.body, turn.odom_from_base.apply(turn.moving))


def way(turns: Sequence[Placed]) -> tuple[Stamps, Floats]:
    """Stamps (N,) and poses (N, 3) of base in odom: x, y (m), yaw (rad, continuous)."""
    poses = np.array([(one.odom_from_base.x, one.odom_from_base.y, one.odom_from_base.yaw) for one in turns]).reshape(-1, 3)
    poses[:, 2] = np.unwrap(poses[:, 2])
    return np.array([one.cloud.stamp_ns for one in turns], np.int64), poses


def build(turns: Iterable[Placed], driven: Floats, mount: LidarMount, config: Config) -> tuple[TruthMap, Stamps, Floats]:
    """The map, and of every KEPT-th turn the stamp and the ranges (K, AZIMUTHS). `driven` (N, 2) m: where base was."""
    pose = base_from_lidar(mount)
    arm = np.hypot(*pose.place[:2])
    builder = TruthBuilder(driven.min(axis=0) - arm, driven.max(axis=0) + arm, config.grid.cell)
    stamps, ranges = [], []
    for number, turn in enumerate(turns):
        one = reduced(turn, pose, config)
        builder.add(one.origin, one.ranges, one.excluded)
        if number % KEPT == 0:
            stamps.append(turn.cloud.stamp_ns)
            ranges.append(np.where(one.excluded, np.inf, one.ranges))
    return builder.finish(), np.array(stamps, np.int64), np.array(ranges)
