"""When the map is looked at, and what is said of the service itself; the grids are held against the map in test_follower.py."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from tests.support import world
from tests.support.cdr_messages import transforms_of
from tests.support.status import status

from echogrid.config.loading import load_config
from echogrid.config.tables import Publish
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.mapper import Judged, MapUpdate
from echogrid.core.motion.error_filter import Certainty
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.live.service import Service
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.topics.announcer import MAPPED, Announcer, Snapshots, occupancy_percent, trinary
from echogrid.topics.cdr import StampError
from echogrid.topics.diagnostic_array import decode_diagnostics
from echogrid.topics.diagnostics import diagnostics
from echogrid.topics.grids import decode_grid
from echogrid.topics.points import decode_judged, decode_points
from echogrid.topics.poses import decode_odometry
from echogrid.topics.topic import (
    DETECTIONS,
    DIAGNOSTICS,
    FULL,
    JUDGED,
    KEY,
    META,
    ODOMETRY,
    STATUS,
    TOPICS,
    TRANSFORM,
    TRINARY,
    UPDATE,
    Message,
    Topic,
)

MS = 1_000_000
CERTAINTY = Certainty(np.array([[4.0, 1.0, 0.1], [1.0, 9.0, 0.2], [0.1, 0.2, 0.25]]), np.array([[0.5, 0.1], [0.1, 0.75]]))
EMPTY = SimpleNamespace(map=OccupancyMap(GridSpec(16, 0.25)), epoch=3, certainty=lambda ego: CERTAINTY)  # all that is asked of a Mapper


@pytest.fixture
def pipeline(tmp_path: Path) -> Pipeline:
    path = world.write_drive(tmp_path, []) / "echogrid.toml"
    return Pipeline(load_config(path), path)


def updated(stamp_ns: int, pose: SE2, points: np.ndarray) -> MapUpdate:
    return MapUpdate(EgoState(stamp_ns, pose, -1.5, 0.25), points)


@given(st.lists(st.integers(-20, 20), min_size=40, max_size=40), st.sampled_from((5.0, 10.0, 20.0)))
def test_of_updates_whose_stamps_jitter_none_of_the_rate_is_lost(jitter: list[int], rate_hz: float) -> None:
    """A map update every 50 ms, give or take 20: one look in every period that has one."""
    snapshots, settings = Snapshots(), Publish(rate_hz=rate_hz)
    stamps = [(50 * n + 25 + late) * MS for n, late in enumerate(jitter)]
    taken = [snapshots.take(EMPTY, updated(stamp_ns, SE2(0, 0, 0), np.zeros((0, 2))), settings) is not None for stamp_ns in stamps]
    assert sum(taken) == len({math.floor(stamp_ns * 1e-9 * rate_hz) for stamp_ns in stamps}) == 2 * rate_hz


def test_what_is_said_of_the_car_is_the_updates(pipeline: Pipeline) -> None:
    points = np.array([[1.5, -2.0], [30.0, 0.25]])
    snapshot = Snapshots().take(EMPTY, updated(77, SE2(1.0, 2.0, 0.5), points), Publish())
    assert snapshot is not None
    told = {message.topic: message for message in Announcer(pipeline.config, "").map(snapshot)}
    assert {(message.stamp_ns, message.epoch) for message in told.values()} == {(77, 3)}
    odometry = decode_odometry(told[ODOMETRY].payload)
    (transform,) = transforms_of(told[TRANSFORM].payload)  # without a pose from outside there is no frame but odom
    assert (odometry.frame, odometry.child_frame, odometry.speed, odometry.yaw_rate) == ("odom", "base", -1.5, 0.25)
    assert (transform.frame, transform.child_frame) == ("odom", "base")
    assert transform.pose == pytest.approx(odometry.pose)
    assert (odometry.pose.x, odometry.pose.y, odometry.pose.yaw) == pytest.approx((1.0, 2.0, 0.5))
    place, motion = odometry.pose_covariance, odometry.twist_covariance
    on_plane = np.ix_((0, 1, 5), (0, 1, 5))
    assert (place[on_plane] == CERTAINTY.pose).all()
    assert (motion[np.ix_((0, 5), (0, 5))] == CERTAINTY.motion).all()
    assert not place[2:5].any()
    assert not motion[1:5].any()
    detections = decode_points(told[DETECTIONS].payload)
    assert detections.frame == "base"
    np.testing.assert_allclose(detections.points, [[1.5, -2.0, 0], [30.0, 0.25, 0]])


def test_a_pose_from_outside_is_a_transform_beside_that_of_the_car(pipeline: Pipeline) -> None:
    """As tf2 wants it: one parent each, and the chain map, odom, base is where the car is in the map frame."""
    update = replace(updated(77, SE2(1.0, 2.0, 0.5), np.zeros((0, 2))), map_from_odom=SE2(100.0, -50.0, 1.0))
    told = {message.topic: message for message in Announcer(pipeline.config, "").map(Snapshots().take(EMPTY, update, Publish()))}
    near, far = transforms_of(told[TRANSFORM].payload)
    assert (near.frame, near.child_frame, far.frame, far.child_frame) == ("odom", "base", "map", "odom")
    assert near.stamp_ns == far.stamp_ns == 77
    chain = far.pose @ near.pose
    turn, place = complex(math.cos(1.0), math.sin(1.0)), complex(100.0, -50.0)
    assert complex(chain.x, chain.y) == pytest.approx(place + turn * complex(1.0, 2.0))
    assert decode_odometry(told[ODOMETRY].payload).pose.x == pytest.approx(1.0)  # which stays in odom


def test_what_was_judged_holds_what_went_into_the_map_and_a_passing_car_is_moving(tmp_path: Path) -> None:
    """Every detection is in it once, with its radar; its static ones are those that are published as such, and those of a car that
    comes towards us are not among them."""
    other = world.moving(world.rectangle(30.0, 4.0), (-8.0, 0.0))
    drive = world.write_drive(
        tmp_path, world.record(world.straight(6.0), [world.standing(world.rectangle(5, -5) + world.rectangle(5, 8)), other], 2.5)
    )
    pipeline = Pipeline(load_config(drive / "echogrid.toml"), drive / "echogrid.toml")
    announcer, verdicts, radars, detections = Announcer(pipeline.config, ""), [], set(), 0
    for update in pipeline.updates(Log(drive / "can.log").batches()):
        snapshot = Snapshots().take(pipeline.mapper, update, pipeline.config.publish)
        told = {message.topic: message for message in announcer.map(snapshot)}
        judged, static = decode_judged(told[JUDGED].payload), decode_points(told[DETECTIONS].payload)
        np.testing.assert_array_equal(judged.points[judged.verdicts == Judged.STATIC], static.points)
        moving = judged.points[judged.verdicts == Judged.MOVING]
        assert ((moving[:, 1] > 2.0) & (moving[:, 1] < 6.0)).all()  # left of us, where the other one drives
        verdicts += judged.verdicts.tolist()
        radars |= set(judged.radars.tolist())
        detections += len(judged.points)
    assert pipeline.health.detections >= detections > 100
    assert set(verdicts) >= {Judged.STATIC, Judged.MOVING}
    assert radars == {0, 1, 2, 3}


def test_status_goes_to_programs_and_to_ros(pipeline: Pipeline) -> None:
    sent = status("degraded", "radar rear_right: late")
    told = {message.topic: message for message in Announcer(pipeline.config, "").status(sent, 78)}
    assert json.loads(told[STATUS].payload) == json.loads(json.dumps(sent))
    assert decode_diagnostics(told[DIAGNOSTICS].payload) == diagnostics(sent, pipeline.config.vehicle, 78)
    assert {message.epoch for message in told.values()} == {sent["epoch"]}


def test_meta_says_where_each_radar_is_and_all_topics(pipeline: Pipeline) -> None:
    meta = json.loads(Announcer(pipeline.config, "the analytic model").meta(5).payload)
    assert (meta["vehicle"], meta["model"], meta["frames"]) == ("test", "the analytic model", {"map": "odom", "car": "base"})
    assert {radar["name"]: (radar["x"], radar["y"], radar["yaw_deg"]) for radar in meta["radars"]} == world.RADARS
    assert meta["grid"]["cell"] == pytest.approx(30 / 128)
    assert meta["keys"] == {topic.name: topic.type or "JSON" for topic in TOPICS}


def test_while_nobody_listens_one_snapshot_a_second_is_taken_and_the_newest_map_is_not_lost() -> None:
    snapshots, settings = Snapshots(), Publish(rate_hz=10.0)
    updates = [updated(50 * n * MS, SE2(0.1 * n, 0, 0), np.zeros((0, 2))) for n in range(66)]
    taken = [snapshots.take(EMPTY, update, settings, listened=False) for update in updates]
    assert [n for n, snapshot in enumerate(taken) if snapshot is not None] == [0, 20, 40, 60]
    late = snapshots.late(EMPTY, settings)
    assert late is not None
    assert late.update is updates[-1]
    assert snapshots.late(EMPTY, settings) is None
    more = [updated((3300 + 50 * n) * MS, SE2(0, 0, 0), np.zeros((0, 2))) for n in range(4)]  # and somebody listens
    assert [snapshots.take(EMPTY, update, settings) is not None for update in more] == [True, False, True, False]
    assert snapshots.late(EMPTY, settings) is None


def test_what_nobody_wants_is_not_made_and_what_is_kept_is(pipeline: Pipeline) -> None:
    announcer, snapshots = Announcer(pipeline.config, ""), Snapshots()
    wanted: set[Topic] = set()
    told = []
    for n in range(4):
        snapshot = snapshots.take(EMPTY, updated((1000 + 100 * n) * MS, SE2(0, 0, 0), np.zeros((0, 2))), Publish(rate_hz=10.0))
        assert snapshot is not None
        told.append({message.topic for message in announcer.map(snapshot, wanted.__contains__)})
        wanted.add((UPDATE, ODOMETRY, JUDGED, DETECTIONS)[n])
    assert told == [{KEY, TRINARY, FULL}, {UPDATE, FULL}, {UPDATE, FULL, ODOMETRY}, {UPDATE, FULL, ODOMETRY, JUDGED}]
    assert {topic for topic in TOPICS if topic not in MAPPED} == {STATUS, DIAGNOSTICS, META}
    status = {"epoch": 0}
    assert [message.topic for message in announcer.status(status, 1, wanted.__contains__)] == [STATUS]
    with pytest.raises(StampError, match="set the clock"):
        next(announcer.status(status, 2**31 * 10**9, wanted.__contains__))


class Full:
    """A sink that takes two messages and then has no room."""

    def wants(self, *topics: Topic) -> bool:
        return True

    def __init__(self) -> None:
        self.taken: list[Message] = []

    def put(self, message: Message) -> None:
        if len(self.taken) == 2:
            raise EchogridError("out.mcap: No space left on device")
        self.taken.append(message)


class Endless(list[Message]):
    put = list.append

    def wants(self, *topics: Topic) -> bool:
        return True


def test_a_sink_that_is_full_is_told_of_once_and_the_others_go_on(pipeline: Pipeline, caplog: pytest.LogCaptureFixture) -> None:
    service, full, endless = Service(pipeline), Full(), Endless()
    service.publishing.sinks.extend((full, endless))
    messages = [Message(STATUS, b"{}", number, 0, 0) for number in range(5)]
    service.publishing.send(messages)
    assert endless == messages
    assert full.taken == messages[:2]
    assert [record.getMessage() for record in caplog.records] == ["out.mcap: No space left on device; continuing without it"]


FREE, INSCRIBED, LETHAL, UNKNOWN = 0, 253, 254, 255  # of nav2_costmap_2d


def static_layer(data: list[int], lethal: int = 100, track_unknown: bool = False, inscribed: int | None = None) -> list[int]:
    """Costs of a map's cells as Nav2's static layer makes them in its default of trinary costs: a model of the rule of
    StaticLayer::interpretValue. `inscribed` is 99 from Lyrical on."""
    costs = []
    for cell in data:
        value = cell % 256  # an int8 is read as an unsigned one
        if value == 255:
            costs.append(UNKNOWN if track_unknown else FREE)
        elif value == inscribed:
            costs.append(INSCRIBED)
        else:
            costs.append(LETHAL if value >= lethal else FREE)
    return costs


@given(st.lists(st.floats(-3.5, 3.5, width=32), min_size=1, max_size=60), st.sampled_from((None, 99)))
def test_nav2_and_amcl_see_obstacles_with_their_defaults(log_odds: list[float], inscribed: int | None) -> None:
    percent = occupancy_percent(np.array([log_odds], dtype=np.float32))
    p = [1 / (1 + math.exp(-value)) for value in log_odds]
    surely = [value for value in p if abs(value - 0.5) > 0.006 and abs(value - 0.1) > 0.006]  # a percent is rounded
    cells = trinary(percent)[0].tolist()
    costs = static_layer(cells, inscribed=inscribed, track_unknown=True)
    for value, known, cell, cost in zip(p, log_odds, cells, costs, strict=True):
        if value in surely:
            assert (cost == LETHAL) == (cell == 100) == (value > 0.5)  # AMCL: occupied
            assert (cost == FREE) == (cell == 0) == (value < 0.1)  # AMCL: free
        if known == 0:
            assert cost == UNKNOWN
    graded = static_layer(percent[0].tolist(), lethal=50, track_unknown=True, inscribed=inscribed)
    assert [cost in (LETHAL, INSCRIBED) for cost in graded] == [cost == LETHAL for cost in costs]


def test_the_trinary_map_is_that_of_the_key_frame(pipeline: Pipeline) -> None:
    grid = OccupancyMap(GridSpec(16, 0.25))
    grid.integrate(np.linspace(-3, 3, 256).reshape(16, 16), SE2(0, 0, 0))
    snapshot = Snapshots().take(
        SimpleNamespace(map=grid, epoch=3, certainty=EMPTY.certainty), updated(77, SE2(0, 0, 0), np.zeros((0, 2))), Publish()
    )
    assert snapshot is not None
    told = {message.topic: message for message in Announcer(pipeline.config, "").map(snapshot)}
    key, sure = decode_grid(told[KEY].payload), decode_grid(told[TRINARY].payload)
    assert (told[KEY].keyframe, key.stamp_ns, key.origin, key.cell) == (told[TRINARY].keyframe, sure.stamp_ns, sure.origin, sure.cell)
    assert set(np.unique(sure.occupancy)) == {-1, 0, 100}
    np.testing.assert_array_equal(sure.occupancy, trinary(key.occupancy))
