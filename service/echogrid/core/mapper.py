"""The spine: from scans and ego motion to the map, one cycle at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from echogrid.core.health import Health
from echogrid.core.history import Detections, History, Looks, Surroundings
from echogrid.core.messages import EgoMotion, Floats, RadarScan
from echogrid.core.mount import Mount
from echogrid.core.odometry import EgoState, Odometry
from echogrid.core.raster import Image
from echogrid.core.static_gate import GateNoise, beside_movers, deviation
from echogrid.core.tiled_map import TiledMap

Infer = Callable[[Surroundings], Image]  # what one update says about the cells around the car, as the map's `integrate` takes it


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
        infer: Infer,
        occupancy: TiledMap,
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
        self.history = History()
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
        """Predict, gate, remember, infer, integrate: what the pending scans say goes into the map, if it takes an update from here."""
        placed = self._place(self.pending)
        self.pending = []
        if not placed:
            return None
        ego = max((ego for _, ego in placed), key=lambda ego: ego.stamp_ns)
        found = self._detections(placed, ego)
        standing = found.deviation <= self.noise.sigmas
        static = found.chosen(standing & ~beside_movers(found.points, ~standing, self.noise))
        self.health.cycles += 1
        self.health.static_detections += len(static)
        if self.map.takes(ego.odom_from_base):
            self.history.add(static, self._looks(placed, ego), ego.odom_from_base, self.odometry.distance)
            self.map.integrate(self.infer(self.history.surroundings(ego.odom_from_base, self._live(ego.stamp_ns))), ego.odom_from_base)
            self.health.tiles_forgotten = self.map.forgotten
        return MapUpdate(ego, static.points)

    def _place(self, scans: list[RadarScan]) -> list[tuple[RadarScan, EgoState]]:
        """The scans with where the car was when each was measured; those without are counted."""
        states = [(scan, self.odometry.at(scan.stamp_ns)) for scan in scans]
        placed = [(scan, ego) for scan, ego in states if ego is not None]
        self.health.scans_without_pose += len(scans) - len(placed)
        return placed

    def _detections(self, placed: list[tuple[RadarScan, EgoState]], now: EgoState) -> Detections:
        """All detections within their radars' range, moving ones too, in base at `now`.

        Each is carried to `now` from where the car was when it was measured.
        """
        parts = []
        for scan, then in placed:
            mount = self.mounts[scan.sensor]
            near = scan.range <= mount.max_range
            range_, azimuth, range_rate = scan.range[near], scan.azimuth[near], scan.range_rate[near]
            in_sensor = np.stack((range_ * np.cos(azimuth), range_ * np.sin(azimuth)), axis=1)
            now_from_sensor = now.odom_from_base.inverse() @ then.odom_from_base @ mount.base_from_sensor
            origins = np.broadcast_to((now_from_sensor.x, now_from_sensor.y), in_sensor.shape)
            sigmas = deviation(azimuth, range_rate, scan.ambiguity, mount, then.speed, then.yaw_rate, self.noise)
            parts.append(Detections(now_from_sensor.apply(in_sensor), origins, scan.rcs[near], sigmas))
        return Detections.joined(parts)

    def _looks(self, placed: list[tuple[RadarScan, EgoState]], now: EgoState) -> Looks:
        """From where the scans were measured, in base at `now`."""
        base_from_odom = now.odom_from_base.inverse()
        return Looks.of([self.mounts[scan.sensor] for scan, _ in placed], [base_from_odom @ then.odom_from_base for _, then in placed])

    def _live(self, now_ns: int) -> list[str]:
        """Radars with a scan that is not older than `max_age_ns`."""
        return [name for name, stamp_ns in self.newest_ns.items() if now_ns - stamp_ns <= self.max_age_ns]
