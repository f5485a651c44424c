"""Dead reckoning of a drive beside its true poses: how far it is off, and whether it says so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.core.health import Health
from echogrid.core.messages import EgoMotion, Floats, PoseFix, RadarScan
from echogrid.core.motion.error_filter import ErrorFilter, Kept, Learns
from echogrid.core.motion.odometry import Odometry
from echogrid.core.radar.doppler_errors import DopplerErrors
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.placed_scan import PlacedScan
from echogrid.core.radar.seen_again import SeenAgain
from echogrid.core.radar.static_gate import GateNoise
from echogrid.core.radar.sweep import Sweep
from echogrid.errors import EchogridError
from echogrid.logs.drive import Truth, find_drive, load_truth
from echogrid.logs.log import Log

CYCLE_NS = 50_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """What the service decodes of a drive with true poses: in the order of reception, with the receive time of the newest frame, ns."""

    name: str
    items: list[tuple[int, RadarScan | EgoMotion]]
    mounts: dict[str, Mount]
    noise: GateNoise
    truth: Truth


@dataclass(frozen=True, slots=True, eq=False)
class Reckoned:
    """Poses (N, 3) x, y, yaw at stamp_ns (N,), their claimed covariances (N, 3, 3), and what was learned by the end."""

    stamp_ns: np.ndarray
    poses: Floats
    covariances: Floats
    learned: dict[str, float]
    kept: Kept


@dataclass(frozen=True, slots=True)
class Score:
    """`off`: RMSE in m after the best rigid alignment, of all and of the second half; `way` in m, of all.

    `place` and `heading`: squared errors at the drive's end from its first pose on, in claimed sigmas: 2 and 1 are expected.
    """

    way: float
    off: float
    later_off: float
    place: float
    heading: float


def hear(folder: Path) -> Heard:
    """A drive folder. Raises EchogridError, also where it has no true poses."""
    drive = find_drive(folder, None)
    config = load_config(drive.config, "analytic")
    truth = load_truth(drive.truth)
    if truth is None:
        raise EchogridError(f"{folder}: has no truth.npz: without true poses there is nothing to compare with")
    signals = SignalReader(config, drive.config, Health())
    items: list[tuple[int, RadarScan | EgoMotion]] = []
    for newest_ns, heard in signals.heard(Log(drive.log).batches(), config.bus):
        items += [(newest_ns, item) for item in heard if not isinstance(item, PoseFix)]
    return Heard(folder.name, items, {radar.name: radar.mount() for radar in config.radar}, config.gate.noise(), truth)


def reckon(heard: Heard, learns: Learns, kept: Kept | None = None, *, same_drive: bool = False) -> Reckoned:
    """As the service reckons, cycle by cycle; every radar is trusted, and there is no map. `kept`: of the drive before, or of this one."""
    errors = ErrorFilter(tuple(heard.mounts), learns)
    if kept is not None:
        errors.recall(kept, same_drive=same_drive)
    odometry, doppler, again = Odometry(errors), DopplerErrors(), SeenAgain()
    waiting: list[RadarScan] = []
    end_ns, stamps, poses, covariances = 0, list[int](), list[tuple[float, float, float]](), list[Floats]()
    for now_ns, item in heard.items:
        if isinstance(item, RadarScan):
            waiting.append(item)
        else:
            odometry.add(item)
        if now_ns < end_ns:
            continue
        end_ns = now_ns // CYCLE_NS * CYCLE_NS + CYCLE_NS
        placed = _placed(waiting, odometry, heard.mounts)
        doppler.add(placed, errors, heard.noise)
        if placed:
            again.add(Sweep.of(placed, heard.noise), errors, heard.noise)
        waiting = []
        if odometry.states:
            newest = odometry.states[-1]
            stamps.append(newest.stamp_ns)
            poses.append((newest.odom_from_base.x, newest.odom_from_base.y, newest.odom_from_base.yaw))
            covariances.append(errors.certainty(newest.speed, newest.yaw_rate).pose)
    if not stamps:
        raise EchogridError(f"{heard.name}: has no ego motion")
    return Reckoned(np.array(stamps), np.array(poses), np.array(covariances), errors.learned(), errors.keep())


def score(reckoned: Reckoned, truth: Truth) -> Score:
    """Where both have poses. Raises EchogridError where that is nowhere."""
    inside = (reckoned.stamp_ns >= truth.stamp_ns[0]) & (reckoned.stamp_ns <= truth.stamp_ns[-1])
    if np.count_nonzero(inside) < 10:
        raise EchogridError("dead reckoning and the true poses have no time in common")
    # Relative to the first stamp: nanoseconds since 1970 do not fit a float64.
    seconds, given = ((stamps - truth.stamp_ns[0]) * 1e-9 for stamps in (reckoned.stamp_ns[inside], truth.stamp_ns))
    x, y, yaw = (np.interp(seconds, given, column) for column in (*truth.poses[:, :2].T, np.unwrap(truth.poses[:, 2])))
    true, ours = np.stack((x, y, yaw), axis=1), reckoned.poses[inside]
    half = len(ours) // 2
    off = _from_first(true)[-1] - _from_first(ours)[-1]
    covariance = _turned(reckoned.covariances[inside][-1], -ours[0, 2])
    place = float(off[:2] @ np.linalg.solve(covariance[:2, :2], off[:2]))
    return Score(_way(true), _aligned(ours, true), _aligned(ours[half:], true[half:]), place, float(off[2] ** 2 / covariance[2, 2]))


def _placed(scans: Sequence[RadarScan], odometry: Odometry, mounts: dict[str, Mount]) -> list[PlacedScan]:
    placed = []
    for scan in scans:
        ego = odometry.at(scan.stamp_ns)
        if ego is not None:
            placed.append(PlacedScan(scan, mounts[scan.sensor], ego))
    return placed


def _way(poses: Floats) -> float:
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def _aligned(ours: Floats, true: Floats) -> float:
    """RMSE (m) of the places after the rotation and translation that make it smallest."""
    a, b = (places[:, 0] + 1j * places[:, 1] for places in (ours, true))
    a, b = a - a.mean(), b - b.mean()
    turn = np.vdot(a, b)
    return float(np.sqrt(np.mean(np.abs(a * turn / max(abs(turn), 1e-12) - b) ** 2)))


def _from_first(poses: Floats) -> Floats:
    """(N, 3) in the frame of the first of them."""
    c, s = np.cos(poses[0, 2]), np.sin(poses[0, 2])
    dx, dy, turned = (poses - poses[0]).T
    return np.stack((c * dx + s * dy, c * dy - s * dx, turned), axis=1)


def _turned(covariance: Floats, turn: float) -> Floats:
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    turned: Floats = rotation @ covariance @ rotation.T
    return turned
