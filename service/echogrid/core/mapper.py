"""The spine: from scans and ego motion to the map, one cycle at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.health import Health
from echogrid.core.messages import EgoMotion, Floats, RadarScan
from echogrid.core.mount import Mount
from echogrid.core.occupancy import OccupancyMap
from echogrid.core.odometry import EgoState, Odometry
from echogrid.core.raster import Image, rasterize
from echogrid.core.static_gate import GateNoise, beside_movers, is_static

InverseSensorModel = Callable[[Image], Image]  # (C, H, W) -> (H, W) log-odds


@dataclass(frozen=True, slots=True, eq=False)
class MapUpdate:
    """One cycle: where the car was at the newest scan, and the static detections (N, 2) in base that went into the map."""

    ego: EgoState
    static_points: Floats  # (N, 2) m, base frame at `ego.stamp_ns`


class Mapper:
    """Remembers the poses, the scans of the running cycle and the map.

    Time comes with the data: `update(now_ns)` ends the cycle when the receive time of the traffic passes the next multiple of
    `cycle_ns`. Every complete scan goes into exactly one cycle.
    """

    def __init__(
        self,
        mounts: Mapping[str, Mount],
        infer: InverseSensorModel,
        occupancy: OccupancyMap,
        health: Health,
        noise: GateNoise,
        cycle_ns: int,
        max_age_ns: int,
    ) -> None:
        self.mounts = mounts
        self.infer = infer
        self.map = occupancy
        self.health = health
        self.noise = noise
        self.cycle_ns = cycle_ns
        self.max_age_ns = max_age_ns
        self.odometry = Odometry()
        self.pending: list[RadarScan] = []
        self.newest_ns: dict[str, int] = {}  # stamp of each sensor's newest scan
        self.cycle_end_ns: int | None = None

    def on_motion(self, motion: EgoMotion) -> None:
        if not self.odometry.add(motion):
            self.health.motion_dropped += 1

    def on_scan(self, scan: RadarScan) -> None:
        sensor = self.health.sensors[scan.sensor]
        late = scan.received_ns - scan.stamp_ns > self.max_age_ns
        if late or scan.stamp_ns <= self.newest_ns.get(scan.sensor, scan.stamp_ns - 1):
            sensor.late += 1
            return
        self.newest_ns[scan.sensor] = scan.stamp_ns
        sensor.complete += 1
        self.health.detections += len(scan)
        self.pending.append(scan)

    def update(self, now_ns: int) -> MapUpdate | None:
        """Ends the cycle if its time is up; the map's next state, or None where there was nothing to add."""
        if self.cycle_end_ns is not None and now_ns < self.cycle_end_ns:
            return None
        self.cycle_end_ns = now_ns // self.cycle_ns * self.cycle_ns + self.cycle_ns
        return self.end_cycle()

    def end_cycle(self) -> MapUpdate | None:
        """Predict, gate, rasterise, infer, integrate: what the pending scans say goes into the map."""
        placed = self._place(self.pending)
        self.pending = []
        if not placed:
            return None
        ego = max((ego for _, ego in placed), key=lambda ego: ego.stamp_ns)
        points, static = self._detections(placed, ego)
        points = points[static & ~beside_movers(points, ~static, self.noise)]
        image = rasterize(points, self.map.spec)
        logits = self.infer(image)
        self.map.integrate(logits, ego.odom_from_base)
        self.health.cycles += 1
        self.health.static_detections += len(points)
        self.health.tiles_forgotten = self.map.forgotten
        return MapUpdate(ego, points)

    def _place(self, scans: list[RadarScan]) -> list[tuple[RadarScan, EgoState]]:
        """The scans with where the car was when each was measured; those without are counted."""
        states = [(scan, self.odometry.at(scan.stamp_ns)) for scan in scans]
        placed = [(scan, ego) for scan, ego in states if ego is not None]
        self.health.scans_without_pose += len(scans) - len(placed)
        return placed

    def _detections(self, placed: list[tuple[RadarScan, EgoState]], now: EgoState) -> tuple[Floats, NDArray[np.bool_]]:
        """All detections within their radars' range, (N, 2) in base at `now`, and which are static by their range rate, (N,).

        Each is carried to `now` from where the car was when it was measured.
        """
        points, static = [], []
        for scan, then in placed:
            mount = self.mounts[scan.sensor]
            near = scan.range <= mount.max_range
            range_, azimuth, range_rate = scan.range[near], scan.azimuth[near], scan.range_rate[near]
            in_sensor = np.stack((range_ * np.cos(azimuth), range_ * np.sin(azimuth)), axis=1)
            now_from_then = now.odom_from_base.inverse() @ then.odom_from_base
            points.append((now_from_then @ mount.base_from_sensor).apply(in_sensor))
            static.append(is_static(azimuth, range_rate, scan.ambiguity, mount, then.speed, then.yaw_rate, self.noise))
        return np.concatenate(points), np.concatenate(static)
