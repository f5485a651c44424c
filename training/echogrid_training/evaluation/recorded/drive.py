"""A recorded drive as the service hears it, frame by frame: what it decodes of it, and where dead reckoning puts its scans."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.map.tiled_map import TiledMap
from echogrid.core.messages import EgoMotion, Floats, PoseFix, RadarScan
from echogrid.core.motion.odometry import EgoState, Odometry
from echogrid.core.radar.mount import Mount
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid_training.realism.figures import residual_of

STEP_NS = 100_000_000  # between two of the poses that the swept ground is made of
STATIC = 0.4  # m/s off a standing thing's range rate; this and the ranges are the reference scores'
NEAREST, FARTHEST = 0.3, 21.0  # m


@dataclass(frozen=True, slots=True, eq=False)
class Reflections:
    """The static detections of one scan in odom, by the reference scores' gate."""

    origin: Floats  # (2,) m, of the sensor
    range: Floats  # (N,) m
    bearing: Floats  # (N,) rad

    @property
    def points(self) -> Floats:
        """(N, 2) m."""
        places: Floats = self.origin + self.range[:, None] * np.stack((np.cos(self.bearing), np.sin(self.bearing)), axis=-1)
        return places


@dataclass(frozen=True, slots=True, eq=False)
class RealDrive:
    """`scans` in order of time, those alone that have a pose."""

    config: Path
    items: list[tuple[int, RadarScan | EgoMotion]]  # with the receive time of the newest frame, ns
    scans: list[tuple[RadarScan, EgoState]]
    driven: list[EgoState]  # every STEP_NS

    def reflections(self, scans: list[tuple[RadarScan, EgoState]]) -> list[Reflections]:
        """Of some of `scans`."""
        mounts = {radar.name: radar.mount() for radar in load_config(self.config).radar}
        return [reflections(scan, ego, mounts[scan.sensor]) for scan, ego in scans]

    def mapped(self, config: Config, left_out: Collection[tuple[str, int]] = ()) -> TiledMap:
        """The map that the service makes of it, without some scans, given by sensor and stamp."""
        mapper = Pipeline(config, self.config).mapper
        for now_ns, item in self.items:
            if not isinstance(item, RadarScan) or (item.sensor, item.stamp_ns) not in left_out:
                for _ in mapper.take(item, now_ns):
                    pass
            mapper.update(now_ns)
        mapper.end_cycle()
        return mapper.map


def hear(source: Path, configuration: Path | None = None) -> RealDrive:
    """A drive folder, or a log with its configuration, decoded once. Raises EchogridError."""
    drive = find_drive(source, configuration)
    config = load_config(drive.config, "analytic")
    signals = Pipeline(config, drive.config).signals
    items: list[tuple[int, RadarScan | EgoMotion]] = []
    for newest_ns, heard in signals.heard(Log(drive.log).batches(), config.bus):
        items += [(newest_ns, item) for item in heard if not isinstance(item, PoseFix)]
    scans, driven = placed([item for _, item in items])
    return RealDrive(drive.config, items, scans, driven)


def placed(items: list[RadarScan | EgoMotion]) -> tuple[list[tuple[RadarScan, EgoState]], list[EgoState]]:
    """By the service's dead reckoning without Doppler: the scans with where the car was, in time order, and where it went by STEP_NS."""
    odometry, waiting = Odometry(), list[RadarScan]()
    scans: list[tuple[RadarScan, EgoState]] = []
    driven: list[EgoState] = []

    def place(until_ns: float) -> None:
        due = [scan for scan in waiting if scan.stamp_ns <= until_ns]
        waiting[:] = [scan for scan in waiting if scan.stamp_ns > until_ns]
        scans.extend((scan, ego) for scan in due if (ego := odometry.at(scan.stamp_ns)) is not None)

    for item in items:
        if isinstance(item, RadarScan):
            waiting.append(item)
            continue
        odometry.add(item)
        if odometry.states:
            newest = odometry.states[-1]
            place(newest.stamp_ns)
            if not driven or newest.stamp_ns - driven[-1].stamp_ns >= STEP_NS:
                driven.append(newest)
    place(float("inf"))
    return sorted(scans, key=lambda one: (one[0].stamp_ns, one[0].sensor)), driven


def reflections(scan: RadarScan, ego: EgoState, mount: Mount) -> Reflections:
    """What stands of a scan, within NEAREST … FARTHEST."""
    odom_from_sensor = ego.odom_from_base @ mount.base_from_sensor
    residual = residual_of(scan, mount, ego.speed, ego.yaw_rate)
    kept = (np.abs(residual) < STATIC) & (scan.range > NEAREST) & (scan.range < FARTHEST)
    return Reflections(np.array((odom_from_sensor.x, odom_from_sensor.y)), scan.range[kept], scan.azimuth[kept] + odom_from_sensor.yaw)
