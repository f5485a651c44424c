"""Recordings from end to end: what they hold was published, and a replay of one is a replay of the drive."""

from __future__ import annotations

import shutil
import threading
from argparse import ArgumentTypeError
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from numpy.typing import NDArray
from rosbags.convert.converter import convert
from rosbags.rosbag2 import Reader
from tests.support import mcap_files, world
from tests.support.foxglove_client import viewer
from tests.support.ports import free_port
from tests.support.program import echogrid
from tests.support.waiting import PATIENCE, until

from echogrid.arguments import address as read_address
from echogrid.can.intake.frames import AnyFrame, FrameBatch
from echogrid.commands.recorder import Recorder
from echogrid.commands.replay import replay
from echogrid.config.loading import load_config
from echogrid.core.mapper import MapUpdate
from echogrid.errors import EchogridError
from echogrid.live.player import AHEAD_FRAMES, on_virtual_buses
from echogrid.live.service import Service
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.recording.mcap_writer import McapWriter
from echogrid.topics.cdr import encode_string
from echogrid.topics.topic import FULL, NAMESPACE, Message, Topic

ROS = {
    "/echogrid/map",
    "/echogrid/map_trinary",
    "/echogrid/map_updates",
    "/echogrid/odom",
    "/tf",
    "/echogrid/detections",
    "/echogrid/detections_judged",
    "/diagnostics",
}
ALL: dict[str, Any] = {
    "dst_version": 8,
    "compress": None,
    "compress_mode": "storage",
    "default_typestore": None,
    "typestore": None,
    **dict.fromkeys(("exclude_topics", "include_topics", "exclude_msgtypes", "include_msgtypes"), ()),
}
JSON = {"/echogrid/status", "/echogrid/meta"}


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 120)])
    return world.write_drive(tmp_path_factory.mktemp("drive"), world.record(world.circle(6.0, 0.1), [wall], 4.0))


def stamps(row: mcap_files.Read) -> set[int]:
    """The stamps in the headers of a message of ROS."""
    headers = [transform.header for transform in row.message.transforms] if row.topic == "/tf" else [row.message.header]
    return {header.stamp.sec * 10**9 + header.stamp.nanosec for header in headers}


def test_a_replay_of_a_recording_of_a_replay_gives_the_same_map_and_the_same_file(drive: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    done = echogrid("replay", drive, "--out", tmp_path / "one", "--record", first)
    assert (done.returncode, done.stderr) == (0, "")
    plain = replay(find_drive(drive, None), tmp_path / "plain")
    again = replay(find_drive(first, drive / "echogrid.toml"), tmp_path / "two", record=second)
    assert again["map_sha256"] == plain["map_sha256"]
    assert again["frames"] == plain["frames"]
    assert first.read_bytes() == second.read_bytes()
    rows = mcap_files.read(first)
    assert {row.topic for row in rows} == ROS | JSON | {"/can/can0"}
    assert all(row.log_time == row.publish_time for row in rows)
    assert all(stamps(row) == {row.log_time} for row in rows if row.topic not in JSON)
    frames = [row.message for row in rows if row.topic == "/can/can0"]
    logged = list(can.LogReader(drive / "can.log"))
    assert [(frame.id, frame.data.tobytes(), frame.timestamp) for frame in frames] == [
        (message.arbitration_id, bytes(message.data), message.timestamp) for message in logged
    ]
    done = echogrid("check", "-c", drive / "echogrid.toml", first)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_recording_is_a_ros_2_bag_and_its_copy_gives_the_same_map(drive: Path, tmp_path: Path) -> None:
    """Converted by rosbags to sqlite3 and back; from the file alone, and from the folder with its metadata.yaml."""
    bag, lone = tmp_path / "bag", tmp_path / "lone.mcap"
    plain = replay(find_drive(drive, None), tmp_path / "plain", record=bag)
    assert sorted(path.name for path in bag.iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    assert replay(find_drive(drive, None), tmp_path / "lone", record=lone)["map_sha256"] == plain["map_sha256"]
    told = []
    for source in (lone, bag):
        with Reader(source) as reader:
            told.append(
                {
                    (c.topic, c.msgtype, c.msgcount, c.ext.offered_qos_profiles[0].durability.name, c.ext.offered_qos_profiles[0].depth)
                    for c in reader.connections
                }
            )
            assert sum(1 for _ in reader.messages()) == reader.message_count
            assert {c.ext.offered_qos_profiles[0].reliability.name for c in reader.connections} == {"RELIABLE"}
            span = (reader.start_time, reader.end_time)
    assert told[0] == told[1]
    assert {name for name, _, _, _, _ in told[0]} == ROS | JSON | {"/can/can0"}
    kept = {name for name, _, _, durability, _ in told[0] if durability == "TRANSIENT_LOCAL"}
    assert kept == {"/echogrid/map", "/echogrid/map_trinary", "/echogrid/meta"}
    rows = mcap_files.read(lone)
    assert span == (min(row.log_time for row in rows), max(row.log_time for row in rows) + 1)
    with lone.open("rb") as file:
        (described,) = make_reader(file).iter_metadata()
    inside = yaml.safe_load(described.metadata["serialized_metadata"])
    beside = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert described.name == "rosbag2"
    assert inside == beside | {"relative_file_paths": [], "files": []}
    assert [entry["path"] for entry in beside["files"]] == beside["relative_file_paths"] == ["bag_0.mcap"]
    for source in (lone, bag):
        convert([source], tmp_path / "sqlite3", dst_storage="sqlite3", **ALL)
        convert([tmp_path / "sqlite3"], tmp_path / "mcap", dst_storage="mcap", **ALL)
        (copy,) = (tmp_path / "mcap").glob("*.mcap")
        assert replay(find_drive(copy, drive / "echogrid.toml"), tmp_path / "again")["map_sha256"] == plain["map_sha256"]
        shutil.rmtree(tmp_path / "sqlite3")
        shutil.rmtree(tmp_path / "mcap")


def test_a_bag_that_is_there_is_not_replaced_and_that_of_another_car_is_taken_away(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(EchogridError, match="bag: exists already, and a recording never replaces a file"):
        McapWriter(tmp_path / "bag")
    (tmp_path / "other.log").write_text("(1.0) can0 123#00\n(2.0) can0 456#00\n")
    with pytest.raises(EchogridError, match="is one that"):
        replay(find_drive(tmp_path / "other.log", drive / "echogrid.toml"), tmp_path / "out", record=tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_folder_may_hold_a_recording(drive: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    (folder / "echogrid.toml").write_bytes((drive / "echogrid.toml").read_bytes())
    plain = replay(find_drive(drive, None), tmp_path / "plain", record=folder / "can.mcap")
    assert replay(find_drive(folder, None), tmp_path / "again")["map_sha256"] == plain["map_sha256"]


def test_a_torn_recording_is_mapped_up_to_where_it_tears(drive: Path, tmp_path: Path) -> None:
    whole, torn = tmp_path / "whole.mcap", tmp_path / "torn.mcap"
    replay(find_drive(drive, None), tmp_path / "plain", record=whole)
    data = whole.read_bytes()
    torn.write_bytes(data[: len(data) // 2])
    done = echogrid("replay", torn, "-c", drive / "echogrid.toml", "--out", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"echogrid: {torn}: cannot be read beyond message ")


def test_a_log_of_another_car_leaves_no_recording_behind(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "other.log").write_text("(1.0) can0 123#00\n(2.0) can0 456#00\n")
    done = echogrid("replay", tmp_path / "other.log", "-c", drive / "echogrid.toml", "--record", tmp_path / "a.mcap")
    assert done.returncode == 3
    assert "none of its 2 frames is one that" in done.stderr
    assert not (tmp_path / "a.mcap").exists()


class Everything:
    """A sink that keeps all."""

    def __init__(self) -> None:
        self.messages: list[Message] = []

    def wants(self, *topics: Topic) -> bool:
        return True

    def put(self, message: Message) -> None:
        self.messages.append(message)


def test_a_running_service_records_what_it_maps_and_publishes_and_shows_it(drive: Path, tmp_path: Path) -> None:
    """Over a virtual bus, with a viewer that watches."""
    path, source = tmp_path / "live.mcap", tmp_path / "echogrid.toml"
    publish = f'\n[publish]\nlisten = ["tcp/127.0.0.1:{free_port()}"]\n'
    source.write_text(world.CONFIG.replace('channel = "can0"', 'channel = "can0"\nlog_channel = 7') + publish)
    pipeline = Pipeline(on_virtual_buses(load_config(source)), source)
    recorder, mapped, sink = Recorder(pipeline), list[AnyFrame](), Everything()

    def take(batch: FrameBatch, buses: NDArray[np.int64]) -> Iterator[tuple[int, MapUpdate | None]]:
        mapped.extend(batch)
        yield from recorder.take(batch, buses)

    service = Service(pipeline, take, record=path, foxglove=("127.0.0.1", 0))
    service.publishing.sinks.append(sink)
    thread = threading.Thread(target=service.run)
    thread.start()
    seen: list[tuple[int, int, bytes]] = []
    try:
        assert service.live.wait(PATIENCE)
        (port,) = [view.port for view in service.publishing.sinks if hasattr(view, "port")]
        logged = list(can.LogReader(drive / "can.log"))
        with (
            viewer(port) as view,
            can.Bus(interface="virtual", channel="can0", protocol=can.CanProtocol.CAN_FD, preserve_timestamps=True) as bus,
        ):
            topics = ["/echogrid/map", "/echogrid/odom", "/echogrid/grid/fused/full", "/echogrid/status"]
            view.subscribe(topics)
            seen.append(until(lambda: view.receive(0.05)))  # a status: the subscription is known
            for number, message in enumerate(logged):
                bus.send(message)
                until(lambda number=number: number - len(mapped) < AHEAD_FRAMES)
            until(lambda: len(mapped) == len(logged))
            while len({number for number, _, _ in seen}) < len(topics):
                seen.append(until(lambda: view.receive(0.05)))
        status = service.status()
    finally:
        service.workers.stop.set()
        thread.join()
    assert service.workers.failure is None
    recording = status["recording"]
    assert (recording["file"], recording["state"], recording["left_out"]) == (str(path), "recording", 0)

    digest = recorder.write(tmp_path / "live", None)["map_sha256"]
    assert replay(find_drive(path, source), tmp_path / "again")["map_sha256"] == digest
    back = list(Log(path))
    assert [(m.arbitration_id, m.timestamp, bytes(m.data)) for m in back] == [
        (m.arbitration_id, m.timestamp, bytes(m.data)) for m in mapped
    ]

    published = [(m.topic.ros or f"{NAMESPACE}/{m.topic.name}", m.stamp_ns, m.payload) for m in sink.messages]
    recorded = [(name, at, payload if name not in JSON else encode_string(payload.decode())) for name, at, payload in published]
    rows = [(row.topic, row.log_time, row.data) for row in mcap_files.read(path) if not row.topic.startswith("/can/")]
    assert rows == [row for row in recorded if row[0] != f"{NAMESPACE}/{FULL.name}"]
    assert {topic for topic, _, _ in rows} == ROS | JSON
    assert {number for number, _, _ in seen} == {0, 1, 2, 3}
    assert {(topics[number], at_ns, payload) for number, at_ns, payload in seen} <= set(published)


@pytest.mark.parametrize(
    ("text", "address"), [("8765", ("127.0.0.1", 8765)), ("0.0.0.0:1", ("0.0.0.0", 1)), ("[::1]:80", ("::1", 80)), ("car:1", ("car", 1))]
)
def test_a_view_is_for_this_machine_alone_unless_a_host_is_written_out(text: str, address: tuple[str, int]) -> None:
    assert read_address(text) == address


@pytest.mark.parametrize("text", ["", "x", ":1", "1:", "65536", "-1", "host"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="is not an address, expected PORT or HOST:PORT"):
        read_address(text)


@pytest.mark.parametrize("name", ["a.blf", "a.log", "a.log.gz", "a.bag"])
def test_a_recording_by_the_name_of_another_format_is_refused(tmp_path: Path, name: str) -> None:
    """It would be a folder, for a bag of ROS 2."""
    with pytest.raises(EchogridError, match=f"{name}: is not written, expected a name that ends in .mcap"):
        McapWriter(tmp_path / name)
    assert list(tmp_path.iterdir()) == []
