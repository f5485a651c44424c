"""A pose from outside through the whole chain: from a log, over a bus and over Zenoh. It moves a frame, and never the map."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import msgspec
import numpy as np
import pytest
import zenoh

from echogrid.commands.replay import replay
from echogrid.config.loading import load_config
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.live.player import Player, on_virtual_buses
from echogrid.live.service import Service
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.recording.published import Published
from echogrid.topics.poses import Odometry, encode_odometry
from echogrid.topics.topic import TRANSFORM
from echogrid.zenoh.publisher import key, session_config
from tests.support import posed, world
from tests.support.cdr_messages import transforms_of
from tests.support.frames import yaw_rate
from tests.support.program import echogrid
from tests.support.waiting import until

SPEED, RATE, BIAS, SECONDS = 6.0, 0.1, math.radians(0.5), 6.0
WORLD = SE2(250.0, -40.0, 2.0)  # where odom's origin truly lies in the map frame
POSE = '\n[pose]\nbus = "can0"\nprofile = "metres.toml"\n'
DRIVEN = world.circle(SPEED, RATE)


def true_pose(time: float) -> SE2:
    return WORLD @ SE2(*DRIVEN(time))


def biased(seconds: float = SECONDS) -> list[can.Message]:
    """A drive whose gyro shows half a degree a second too much."""
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 120)])
    messages = world.record(DRIVEN, [wall, world.standing(world.rectangle(12, -5))], seconds)
    gyro = [message for message in messages if message.arbitration_id == 0x102]
    shown = {id(message): yaw_rate(RATE + BIAS, n, message.timestamp) for n, message in enumerate(gyro)}
    return [shown.get(id(message), message) for message in messages]


def poses(seconds: float = SECONDS, begin: float = 0.0) -> list[can.Message]:
    """Ten a second, 4 ms after the drive's own frames."""
    times = np.arange(round(begin * 10), round(seconds * 10)) / 10 + 0.004
    told = [(true_pose(float(time)), float(time)) for time in times]
    return [posed.metres(at.x, at.y, math.remainder(at.yaw, math.tau), n, 100 + time) for n, (at, time) in enumerate(told)]


def write(folder: Path, messages: list[can.Message], pose: str = POSE, config: str = world.CONFIG) -> Path:
    posed.write(folder)
    return world.write_drive(folder, sorted(messages, key=lambda message: message.timestamp), config + pose)


def car_in_the_world(summary: dict[str, object], trajectory: Path) -> SE2:
    """At the end of a replay, by its own files."""
    *_, last = trajectory.read_text().splitlines()
    _, x, y, yaw = (float(number) for number in last.split(","))
    pose = summary["pose"]
    assert isinstance(pose, dict)
    at = pose["map_from_odom"]
    return SE2(at["x"], at["y"], math.radians(at["yaw_deg"])) @ SE2(x, y, yaw)


def test_of_a_log_it_moves_the_frame_and_not_one_cell(tmp_path: Path) -> None:
    """The same drive with and without it: the same map, bit for bit; and the car is in the map frame where it truly is."""
    with_pose = write(tmp_path / "with", biased() + poses())
    summary = replay(find_drive(with_pose, None), tmp_path / "out")
    without = replay(find_drive(write(tmp_path / "without", biased(), ""), None), tmp_path / "plain")
    assert summary["map_sha256"] == without["map_sha256"] is not None
    assert (tmp_path / "out" / "trajectory.csv").read_bytes() == (tmp_path / "plain" / "trajectory.csv").read_bytes()
    assert without["pose"] is None
    assert summary["pose"]["state"] == "ok"
    assert summary["pose"]["taken"] >= 58
    here, true = car_in_the_world(summary, tmp_path / "out" / "trajectory.csv"), true_pose(SECONDS)
    assert math.hypot(here.x - true.x, here.y - true.y) < 0.15
    assert math.remainder(here.yaw - true.yaw, math.tau) == pytest.approx(0.0, abs=2e-3)
    drifted = summary["pose"]["map_from_odom"]["yaw_deg"] - math.degrees(WORLD.yaw)
    assert drifted == pytest.approx(-math.degrees(BIAS) * (SECONDS - 0.1), abs=0.15)  # what the gyro showed too much
    again = replay(find_drive(with_pose, None), tmp_path / "again")
    assert again["pose"] == summary["pose"]


def test_frames_that_are_no_poses_are_counted_and_said(tmp_path: Path) -> None:
    """From the third second on: without a fix, then nothing. The state of the map does not depend on it."""
    good, later = poses(3.0), poses(5.0, begin=3.0)
    for message in later:
        message.data[10] &= 0xF0  # Fix = 0
        message.data[11] = 0
        message.data[11] = posed.crc8(bytes(message.data[:11] + message.data[12:]))
    summary = replay(find_drive(write(tmp_path / "drive", biased() + good + later), None), tmp_path / "out")
    assert summary["state"] == "ok"
    told = summary["pose"]
    assert (told["state"], told["taken"], told["invalid"]) == ("silent", 30, 20)
    assert told["reason"].startswith("none for 3.")
    assert told["reason"].endswith(" s (20 invalid)")
    assert told["map_from_odom"] is not None


def test_a_new_map_has_no_frame_until_the_next_pose(tmp_path: Path) -> None:
    """Frames are missing for a second, and so is the way of the car in it: odom has another origin."""
    silent = [message for message in biased() + poses() if not 3.0 < message.timestamp - 100 < 4.0]
    ends = [message for message in silent if not (message.arbitration_id == 0x200 and message.timestamp > 103.0)]
    summary = replay(find_drive(write(tmp_path / "ends", ends), None), tmp_path / "out")
    assert len(summary["maps_begun"]) == 1
    assert summary["pose"]["map_from_odom"] is None
    assert summary["pose"]["state"] == "waiting"
    summary = replay(find_drive(write(tmp_path / "goes on", silent), None), tmp_path / "on")
    here, true = car_in_the_world(summary, tmp_path / "on" / "trajectory.csv"), true_pose(SECONDS)
    assert math.hypot(here.x - true.x, here.y - true.y) < 0.15


def test_a_recording_of_a_replay_holds_the_transform(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    drive = write(tmp_path / "drive", biased() + poses())
    summary = replay(find_drive(drive, None), tmp_path / "out", record=tmp_path / "drive.mcap")
    items = list(Published(tmp_path / "drive.mcap"))
    (status, *_), meta = [item.status for item in items if item.status], next(item.meta for item in items if item.meta)
    assert status["pose"]["state"] in ("ok", "waiting")
    assert meta["frames"] == {"map": "odom", "car": "base", "fixed": "map"}
    again = replay(find_drive(tmp_path / "drive.mcap", drive / "echogrid.toml"), tmp_path / "again")
    assert again["pose"] == summary["pose"]


@contextmanager
def running(path: Path) -> Iterator[Service]:
    """A service that hears the drive on virtual buses, at its own pace, until it ends."""
    config = on_virtual_buses(load_config(path))
    service = Service(Pipeline(config, path))
    player = Player(service, Log(path.parent / "can.log"), speed=1.0)
    service.workers.add("player", player.run)
    thread = threading.Thread(target=service.run)
    thread.start()
    try:
        yield service
    finally:
        service.workers.stop.set()
        thread.join()


def transforms(session: zenoh.Session) -> zenoh.Subscriber:
    return session.declare_subscriber(key("test", TRANSFORM.name))


def placed(subscriber: zenoh.Subscriber) -> SE2 | None:
    """The car in the map frame, as a program behind tf would have it."""
    sample = subscriber.try_recv()
    if sample is None:
        return None
    by_frame = {one.frame: one for one in transforms_of(bytes(sample.payload))}
    return None if "map" not in by_frame else by_frame["map"].pose @ by_frame["odom"].pose


@pytest.mark.parametrize("way", ["bus", "zenoh"])
def test_of_a_running_service_tf_has_the_car_where_it_truly_is(tmp_path: Path, endpoint: str, way: str) -> None:
    publish = f'\n[publish]\nlisten = ["{endpoint}"]\n'
    pose = POSE if way == "bus" else '\n[pose]\nkey = "ins/**"\n'
    messages = biased(12.0)
    drive = write(tmp_path / "drive", messages + (poses(12.0) if way == "bus" else []), pose + publish)
    with zenoh.open(session_config((), (endpoint,), sends=False)) as session, running(drive / "echogrid.toml") as service:
        subscriber, stop = transforms(session), threading.Event()
        sender = threading.Thread(target=tell, args=(session, service, stop))
        if way == "zenoh":
            sender.start()
        try:
            until(lambda: service.status()["pose"]["taken"] > 10)
            while subscriber.try_recv() is not None:
                pass
            here = until(lambda: placed(subscriber))
            ego = service.pipeline.mapper.odometry.states[-1]
            time = (ego.stamp_ns * 1e-9 - 100) if ego else 0.0
            true = true_pose(time)
            assert math.hypot(here.x - true.x, here.y - true.y) < 1.5  # what the car goes meanwhile
            status = service.status()["pose"]
            assert status["state"] == "ok"
            assert status["map_from_odom"]["yaw_deg"] == pytest.approx(math.degrees(WORLD.yaw - BIAS * time), abs=0.3)
            if way == "zenoh":
                session.put("ins/odom", b"\x00\x01\x00\x00 no odometry")
                session.put("ins/odom", bytes(100_000))
                until(lambda: service.status()["pose"]["invalid"] >= 2)
                stop.set()
                sender.join()
                until(lambda: service.status()["pose"]["state"] == "silent")
                assert service.status()["state"] == "ok"
        finally:
            stop.set()
            if way == "zenoh":
                sender.join()


def tell(session: zenoh.Session, service: Service, stop: threading.Event) -> None:
    """Where the car truly is, by the traffic's own time, with a roll and a pitch, and covariances that are none."""
    publisher = session.declare_publisher("ins/odom")
    while not stop.wait(0.03):
        newest_ns = service.pipeline.signals.newest_ns
        if newest_ns is None:
            continue
        at = true_pose(newest_ns * 1e-9 - 100)
        odometry = Odometry(newest_ns, "world", "ins", at, 0.0, 0.0, np.full((6, 6), np.nan), np.full((6, 6), np.inf))
        publisher.put(encode_odometry(odometry))


@pytest.mark.parametrize(
    ("key_expression", "expected"),
    [
        ("echogrid/v1/test/odom", "pose.key: 'echogrid/v1/test/odom' found, which takes in 'echogrid/v1/test/**', expected none of"),
        ("**", "pose.key: '**' found, which takes in 'echogrid/v1/test/**'"),
        ("0/echogrid/**", "pose.key: '0/echogrid/**' found, which takes in '0/echogrid/"),
        ("@ros2_lv/**", "pose.key: '@ros2_lv/**' found, which takes in '@ros2_lv/**'"),
        ("ins//odom", "pose.key: 'ins//odom' found, expected a key expression of Zenoh such as ins/odom or 0/ins/odom/**"),
        ("", "pose.key: an empty text found, expected a name"),
    ],
)
def test_a_key_that_is_none_or_ours_is_refused_before_anything_is_opened(tmp_path: Path, key_expression: str, expected: str) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(world.CONFIG + f'\n[pose]\nkey = "{key_expression}"\n')
    done = echogrid("check", "-c", path)
    assert done.returncode == 1
    assert done.stderr.startswith(f"echogrid: {path}: {expected}")
    assert done.stderr.count("\n") == 1
    with pytest.raises(EchogridError) as caught:
        Service(Pipeline(load_config(path), path)).run()
    assert expected in str(caught.value)


def test_a_replay_says_that_it_hears_no_zenoh(tmp_path: Path) -> None:
    drive = write(tmp_path / "drive", biased(2.0), '\n[pose]\nkey = "ins/odom"\n')
    summary = replay(find_drive(drive, None), tmp_path / "out")
    assert summary["pose"]["state"] == "waiting"
    assert [note for note in summary["notes"] if note.startswith("pose.key: a recording holds no messages of Zenoh")]


def test_check_says_where_the_poses_are(tmp_path: Path) -> None:
    """Alone, with a log that has them, with one that has none, and with one that has them on another bus."""
    there = write(tmp_path / "there", biased(3.0) + poses(3.0))
    done = echogrid("check", "-c", there / "echogrid.toml")
    assert (done.returncode, done.stderr) == (0, "")
    assert "4 radars and ego motion, and a pose from bus can0, on 1 bus," in done.stdout
    codes = {}
    for name, messages in (("there", None), ("none", biased(3.0)), ("other", biased(3.0) + [on_can1(message) for message in poses(3.0)])):
        folder = there if messages is None else write(tmp_path / name, messages, POSE + '\n[[bus]]\nname = "ins"\nchannel = "can1"\n')
        done = echogrid("check", "-c", folder / "echogrid.toml", folder / "can.log", "--json")
        findings = json.loads(done.stdout)["findings"]
        codes[name] = {one["code"]: one["fix"] for one in findings if one["subject"] == "pose"}
    assert codes["there"] == {}
    assert list(codes["none"]) == ["pose_missing"]
    assert codes["other"] == {"wrong_bus": ['[pose]: bus = "ins"']}


def on_can1(message: can.Message) -> can.Message:
    message.channel = "can1"
    return message


def test_the_status_can_be_sent(tmp_path: Path) -> None:
    drive = write(tmp_path / "drive", [])
    status = Service(Pipeline(load_config(drive / "echogrid.toml"), drive / "echogrid.toml")).status()
    assert json.loads(msgspec.json.encode(status))["pose"]["state"] == "waiting"
