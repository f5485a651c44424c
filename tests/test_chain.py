"""The whole chain on small worlds: what stands where, appears there; what moves, leaves nothing behind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import can
import numpy as np
import pytest

from echogrid.can.intake.frames import FrameBatch
from echogrid.config.loading import load_config
from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import UPDATES, LookMap
from echogrid.core.map.tiled_map import probability
from echogrid.core.motion.se2 import SE2
from echogrid.pipeline import Pipeline
from tests.support import networks, world

WALL = world.standing([(x * 0.3, 6.0) for x in range(-20, 160)])


def mapped(tmp_path: Path, messages: Sequence[can.Message], model: str = "analytic") -> Pipeline:
    pipeline = made(tmp_path, model)
    for _ in pipeline.updates([FrameBatch.of(messages)]):
        pass
    pipeline.mapper.end_cycle()
    return pipeline


def made(tmp_path: Path, model: str = "analytic") -> Pipeline:
    path = tmp_path / "echogrid.toml"
    path.write_text(world.CONFIG)
    return Pipeline(load_config(path, model), path)


def occupied(pipeline: Pipeline, threshold: float = 0.7) -> np.ndarray:
    """(N, 2) x and y of the centres of occupied cells."""
    row, column, log_odds = pipeline.mapper.map.whole()
    rows, columns = np.nonzero(probability(log_odds) > threshold)
    return (np.stack((columns + column, rows + row), axis=1) + 0.5) * pipeline.mapper.map.spec.cell


def probability_at(pipeline: Pipeline, x: float, y: float) -> float:
    cell = pipeline.mapper.map.spec.cell
    return float(probability(pipeline.mapper.map.window(int(y // cell), int(x // cell), 1, 1))[0, 0])


def test_a_wall_on_the_left_appears_at_plus_y(tmp_path: Path) -> None:
    pipeline = mapped(tmp_path, world.record(world.straight(6.0), [WALL], 5.0))
    cells = occupied(pipeline)
    assert len(cells) > 60
    assert np.abs(cells[:, 1] - 6.0).max() < 0.5
    for x in range(2, 25):
        assert probability_at(pipeline, x, 3.0) < 0.3
    assert np.count_nonzero(pipeline.mapper.map.whole()[2][: -int(6.5 / 0.234)] > 0.5) == 0


def test_after_a_turn_to_the_left_a_ring_is_still_a_ring(tmp_path: Path) -> None:
    """Round a circle of 15 m in the middle of a ring of 22 m: pose, mounts and raster must agree on every sign."""
    angles = np.arange(0, 2 * np.pi, 0.02)
    ring = world.standing([(22 * np.cos(a), 15 + 22 * np.sin(a)) for a in angles])
    pipeline = mapped(tmp_path, world.record(world.circle(7.5, 0.5), [ring], 13.0))
    cells = occupied(pipeline)
    radius = np.hypot(cells[:, 0], cells[:, 1] - 15)
    assert len(cells) > 400
    assert np.abs(radius - 22).max() < 0.6


def test_a_car_that_drives_by_leaves_nothing_behind_and_a_parked_one_stays(tmp_path: Path) -> None:
    parked = world.standing(world.rectangle(14.0, 4.2))
    passing = world.moving(world.rectangle(70.0, 3.0), (-12.0, 0.0))  # oncoming, from far ahead to far behind
    overtaking = world.moving(world.rectangle(-30.0, -3.0), (14.0, 0.0))
    pipeline = mapped(tmp_path, world.record(world.straight(5.0), [WALL, parked, passing, overtaking], 6.0))
    cells = occupied(pipeline)
    on_wall = np.abs(cells[:, 1] - 6.0) < 0.5
    on_parked = (np.abs(cells[:, 0] - 14.0) < 2.7) & (np.abs(cells[:, 1] - 4.2) < 1.4)
    assert on_parked.sum() > 15
    assert cells[~on_wall & ~on_parked].tolist() == []


def test_standing_in_traffic_the_passing_cars_leave_nothing_either(tmp_path: Path) -> None:
    passing = world.moving(world.rectangle(40.0, 3.5), (-10.0, 0.0))
    pipeline = mapped(tmp_path, world.record(world.straight(0.0), [WALL, passing], 8.0))
    cells = occupied(pipeline)
    assert cells[np.abs(cells[:, 1] - 6.0) >= 0.5].tolist() == []


def test_the_time_of_measurement_counts_not_that_of_arrival(tmp_path: Path) -> None:
    """At 14 m/s an age of 90 ms is 1.3 m: a post must stand where it stands, and only there."""
    post = world.standing([(20.0, 5.0)])
    pipeline = mapped(tmp_path, world.record(world.straight(14.0), [post], 3.0, age=0.09))
    cells = occupied(pipeline)
    assert len(cells) > 0
    assert np.hypot(cells[:, 0] - 20, cells[:, 1] - 5).max() < 0.6


@pytest.mark.parametrize("drop", ["motion", "radar"])
def test_without_ego_motion_or_radars_there_is_no_map(tmp_path: Path, drop: str) -> None:
    messages = world.record(world.straight(6.0), [WALL], 1.0)
    kept = [m for m in messages if (m.arbitration_id >= 0x300) == (drop == "motion")]
    pipeline = mapped(tmp_path, kept)
    assert pipeline.mapper.map.whole()[2].size == 0
    scans = sum(sensor.complete for sensor in pipeline.health.sensors.values())
    assert pipeline.health.scans_without_pose == (scans if drop == "motion" else 0)
    assert (scans > 0) == (drop == "motion")


def test_a_map_update_is_made_with_the_last_scan_that_is_due_however_frames_are_grouped(tmp_path: Path) -> None:
    """A replay takes hundreds of frames at once, a bus those of 3 ms."""
    messages = world.record(world.straight(6.0), [WALL], 2.0)
    found = []
    for size in (1, 17, len(messages)):
        pipeline, ends = made(tmp_path), list[int]()
        for begin in range(0, len(messages), size):
            batch = FrameBatch.of(messages[begin : begin + size])
            ends += [begin + end for end, update in pipeline.take(batch, np.zeros(len(batch), np.int64)) if update is not None]
        found.append((ends, pipeline.mapper.map.whole()[2].tobytes()))
    assert found[0] == found[1] == found[2]
    last = [messages[end - 1].arbitration_id for end in found[0][0]]
    assert len(last) > 30
    assert sum(number >= 0x300 for number in last[4:]) == len(last[4:])  # a radar's


def shown(pipeline: Pipeline, messages: Sequence[can.Message]) -> list[tuple[SE2, Surroundings]]:
    """What each update is drawn from, and the pose that it belongs to."""
    pairs: list[tuple[SE2, Surroundings]] = []
    seen: list[Surroundings] = []
    infer = pipeline.mapper.infer

    def noted(around: Surroundings) -> np.ndarray:
        seen.append(around)
        return infer(around)

    pipeline.mapper.infer = noted
    for update in pipeline.updates([FrameBatch.of(messages)]):
        pairs.append((update.ego.odom_from_base, seen[-1]))
    return pairs


def test_a_network_is_shown_what_stands_and_from_where_it_was_measured(tmp_path: Path) -> None:
    """Round a bend past a wall, with a car that passes: what is left of the last 15 m lies on the wall but for single ones of the car,
    and every ray and every look comes from where a radar once was on the path that was driven.
    """
    path = world.circle(8.0, 0.1)
    passing = world.moving(world.rectangle(60.0, 3.0), (-12.0, 0.0))
    found = shown(made(tmp_path), world.record(path, [WALL, passing], 4.0))
    driven = np.array([path(t) for t in np.arange(0.0, 4.2, 0.005)])
    cos, sin = np.cos(driven[:, 2]), np.sin(driven[:, 2])
    mounts = [(x, y) for x, y, _ in world.RADARS.values()]
    ever = np.concatenate([np.stack((driven[:, 0] + cos * x - sin * y, driven[:, 1] + sin * x + cos * y), axis=1) for x, y in mounts])
    for base, around in found[5::10]:
        assert (np.abs(base.apply(around.past.points)[:, 1] - 6.0) < 0.3).mean() > 0.99
        for places in (base.apply(np.unique(around.past.origins, axis=0)), base.apply(around.looks.place[:, :2])):
            assert np.hypot(*(ever[:, None] - places).transpose(2, 0, 1)).min(axis=0).max() < 0.08
        assert (around.age.min(), len(around.live)) == (0.0, 4)
        assert around.age.max() <= 15.0
    assert max(around.age.max() for _, around in found) > 14.0
    assert len(found) > 60


def test_a_radar_that_falls_silent_is_no_longer_counted_on(tmp_path: Path) -> None:
    """Two seconds on, its frames (ids from 0x310 on) stop: a network must not take its silence for free space."""
    messages = world.record(world.straight(5.0), [WALL], 4.0)
    kept = [m for m in messages if not (0x310 <= m.arbitration_id < 0x320 and m.timestamp > 102.0)]
    live = [set(around.live) for _, around in shown(made(tmp_path), kept)]
    assert live[30] == set(world.RADARS)
    assert live[-1] == set(world.RADARS) - {"front_right"}


@pytest.fixture
def network(tmp_path: Path) -> str:
    spec = GridSpec()
    return str(networks.write(tmp_path / "net.onnx", *networks.default(spec.cells, spec.cell)))


def test_with_a_network_the_wall_stands_where_it_stands(tmp_path: Path, network: str) -> None:
    """One that calls occupied what was hit and free what was looked at: by its mean over looks."""
    pipeline = mapped(tmp_path, world.record(world.straight(6.0), [WALL], 4.0), network)
    assert isinstance(pipeline.mapper.map, LookMap)
    cells = occupied(pipeline)
    assert len(cells) > 60
    assert np.abs(cells[:, 1] - 6.0).max() < 1.2  # far ahead, a beam's two sigmas are 0.9 m wide
    for x in range(2, 18):
        assert 0 < probability_at(pipeline, x, 3.0) < 0.3


def test_a_standing_car_learns_nothing_new(tmp_path: Path, network: str) -> None:
    """After a look's four updates the map stays, bit for bit, however long it stands and whatever passes."""
    pipeline = made(tmp_path, network)
    passing = world.moving(world.rectangle(40.0, 3.5), (-10.0, 0.0))
    digests = []
    for _ in pipeline.updates([FrameBatch.of(world.record(world.straight(0.0), [WALL, passing], 3.0))]):
        digests.append(pipeline.mapper.map.window_of_layers(-128, -128, 256, 256).tobytes())
    assert len(digests) > 40
    assert len(set(digests)) == len(set(digests[:UPDATES])) == UPDATES
