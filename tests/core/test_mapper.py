"""What the mapper takes and what it counts: a scan is as old as is allowed, and none is forgotten without being counted."""

from __future__ import annotations

import numpy as np
import pytest

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.health import Health, PoseHealth, SensorHealth
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.mapper import Mapper
from echogrid.core.messages import PoseFix, RadarScan, Speed, YawRate
from echogrid.core.motion.map_frame import MapFrame
from echogrid.core.motion.se2 import IDENTITY, SE2
from echogrid.core.radar.mount import Mount
from echogrid.core.radar.static_gate import GateNoise

MS = 1_000_000
SPEC = GridSpec(32, 0.25)
OLDEST = 200 * MS


def made(frame: MapFrame | None = None) -> Mapper:
    mounts = {name: Mount(SE2(x, 0.0, 0.0), 1.0, 25.0) for name, x in (("front", 3.7), ("rear", -0.8))}
    health = Health(sensors={name: SensorHealth() for name in mounts})
    occupancy = OccupancyMap(SPEC, 3.5)
    return Mapper(mounts, lambda _: np.zeros((32, 32), np.float32), occupancy, health, GateNoise(), 50 * MS, OLDEST, frame=frame)


@pytest.fixture
def mapper() -> Mapper:
    return made()


def scan(sensor: str, stamp_ns: int, age_ns: int) -> RadarScan:
    return RadarScan(sensor, stamp_ns, stamp_ns + age_ns, *np.zeros((4, 0)))


def test_a_scan_is_late_from_the_first_nanosecond_beyond_what_is_allowed(mapper: Mapper) -> None:
    mapper.on_scan(scan("front", 1000 * MS, OLDEST))
    mapper.on_scan(scan("rear", 1000 * MS, OLDEST + 1))
    assert [(health.complete, health.late) for health in mapper.health.sensors.values()] == [(1, 0), (0, 1)]
    assert mapper._live(1000 * MS + OLDEST) == ["front"]
    assert mapper._live(1000 * MS + OLDEST + 1) == []


def test_scans_of_a_disputed_motion_are_counted_with_those_without_a_pose(mapper: Mapper, monkeypatch: pytest.MonkeyPatch) -> None:
    """One before the first ego motion, then two while the wheels are not believed."""
    mapper.on_scan(scan("front", 5 * MS, 0))
    assert mapper.end_cycle() is None
    for n in range(1, 12):
        mapper.on_motion(Speed(n * 10 * MS, 5.0))
        mapper.on_motion(YawRate(n * 10 * MS, 0.0))
    monkeypatch.setattr(mapper.watch, "judge", lambda placed: setattr(mapper.watch.motion, "disputed", "by two radars"))
    for sensor in mapper.mounts:
        mapper.on_scan(scan(sensor, 100 * MS, 0))
    assert mapper.end_cycle() is None
    assert mapper.health.scans_without_pose == 3


def test_what_moves_and_what_is_among_movers_is_not_mapped(mapper: Mapper) -> None:
    """Ahead of a car at 5 m/s: a post, a mover alone, and two movers with something between them that seems to stand."""
    for n in range(1, 12):
        mapper.on_motion(Speed(n * 10 * MS, 5.0))
        mapper.on_motion(YawRate(n * 10 * MS, 0.0))
    distance, rate = np.array((6.0, 10.0, 15.0, 16.0, 17.0)), np.array((-5.0, 4.0, 4.0, -5.0, 4.0))
    mapper.on_scan(RadarScan("front", 100 * MS, 100 * MS, distance, np.zeros(5), rate, np.zeros(5)))
    update = mapper.end_cycle()
    assert update is not None
    assert mapper.health.static_detections == 1
    np.testing.assert_allclose(update.static_points, [(9.7, 0.0)], atol=1e-9)  # in base: the radar is 3.7 m ahead


def test_a_clock_that_is_set_back_begins_a_map_that_no_pose_has_placed_yet() -> None:
    """From the first nanosecond before the time until which frames may come out of order."""
    mapper = made(MapFrame(IDENTITY, PoseHealth()))
    for n in range(1, 12):
        mapper.on_motion(Speed(1000 * MS + n * 10 * MS, 5.0))
        mapper.on_motion(YawRate(1000 * MS + n * 10 * MS, 0.0))
    mapper.on_pose(PoseFix(1050 * MS, 12.0, -3.0, 1050 * MS, 0.5))
    mapper.on_scan(RadarScan("front", 1100 * MS, 1100 * MS, np.array([6.0]), np.zeros(1), np.array([-5.0]), np.zeros(1)))
    update = mapper.end_cycle()
    assert update is not None
    assert update.map_from_odom is not None
    assert update.map_from_odom.yaw == pytest.approx(0.5)
    assert mapper.epoch == 0
    mapper.on_scan(scan("front", 1110 * MS, 0))
    earliest_ns, _ = mapper.span()
    assert mapper.update(earliest_ns) is None
    assert mapper.epoch == 0
    mapper.update(earliest_ns - 1)
    assert mapper.epoch == 1
    assert mapper.frame is not None
    assert mapper.frame.map_from_odom is None


def test_a_sample_that_is_left_out_is_counted_once(mapper: Mapper) -> None:
    for seconds, speed in ((1.0, 5.0), (1.0, 5.0), (0.99, 5.0), (1.01, 60.0), (1.02, 5.0)):
        mapper.on_motion(Speed(round(seconds * 1e9), speed))
    assert (mapper.health.motion_dropped, mapper.health.motion_implausible) == (2, 1)


def test_a_cycle_is_learned_from_behind_its_map_and_before_what_is_heard_next(mapper: Mapper, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sample whose time ends the cycle is the first that is corrected by it."""
    for n in range(1, 12):
        mapper.on_motion(Speed(n * 10 * MS, 5.0))
        mapper.on_motion(YawRate(n * 10 * MS, 0.0))
    mapper.on_scan(scan("front", 100 * MS, 0))
    order: list[str] = []
    monkeypatch.setattr(mapper.doppler, "add", lambda *_: order.append("learned"))
    monkeypatch.setattr(mapper.odometry, "add", lambda _: order.append("heard"))
    for _ in mapper.take(Speed(120 * MS, 5.0), 400 * MS):
        order.append("mapped")
    assert order == ["mapped", "learned", "heard"]
