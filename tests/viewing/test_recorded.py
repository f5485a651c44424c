"""A recording as it is shown: after the last frame the page knows the map of a replay, wherever it began and whatever it skipped."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import can
import numpy as np
import pytest
from tests.support import world
from tests.support.pages import Seen, served, watch
from tests.support.status import status

from echogrid.commands.replay import replay
from echogrid.config.loading import load_config
from echogrid.core.mapper import Judged
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.recording.mcap_writer import McapWriter
from echogrid.topics.announcer import occupancy_percent
from echogrid.topics.topic import STATUS, Message
from echogrid.viewing.recorded import DriveFeed, McapFeed
from echogrid.viewing.shows import MapShow, TapeShow
from echogrid.viewing.stored import stored_scene
from echogrid.viewing.tape import newest
from echogrid.viewing.wire import Kind, Plane

SECONDS = 9.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive past a wall, parked cars and one that comes towards us; the front right radar falls silent after 5 s."""
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 200)])
    other = world.moving(world.rectangle(60.0, 3.0), (-5.0, 0.0))
    messages = world.record(world.circle(6.0, 0.05), [wall, world.standing(world.rectangle(12, -5)), other], SECONDS)
    lost = range(16, 32)  # the id offset of front_right
    heard = [message for message in messages if not (message.timestamp > 105 and message.arbitration_id - 0x300 in lost)]
    return world.write_drive(tmp_path_factory.mktemp("drive"), heard)


@pytest.fixture(scope="module")
def feed(folder: Path) -> DriveFeed:
    feed = DriveFeed(find_drive(folder, None), None)
    feed.run(threading.Event())
    return feed


@pytest.fixture(scope="module")
def dense(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, int, int]:
    """Percent of the whole map by replay, and row and column of its first cell."""
    out = tmp_path_factory.mktemp("out")
    replay(find_drive(folder, None), out)
    with np.load(out / "map.npz") as file:
        x, y = file["origin"] / float(file["cell"])
        return occupancy_percent(file["log_odds"]), round(float(y)), round(float(x))


class Ready(TapeShow):
    """Of a tape that is complete."""

    def work(self, stop: threading.Event) -> None:
        pass


def played(feed: DriveFeed | McapFeed, first: int = 0) -> Seen:
    """All of the tape from an entry on, as a viewer would hear it that begins there."""
    tape, seen = feed.tape, Seen()
    frames, done = tape.whole_before(first)
    for frame in [*frames, *newest(tape.between(done, tape.count(tape.end)))]:
        seen.take(frame)
    return seen


def test_wherever_one_begins_the_end_is_the_same(feed: DriveFeed) -> None:
    whole = played(feed)
    assert feed.tape.count(feed.tape.end) > 80
    assert 8.0 < feed.tape.end < SECONDS
    for first in (1, 30, 41, 79, feed.tape.count(feed.tape.end)):
        other = played(feed, first)
        assert other.blocks.keys() == whole.blocks.keys()
        assert all(np.array_equal(other.blocks[key], cells) for key, cells in whole.blocks.items())
        assert other.pose == whole.pose
        assert other.documents[Kind.STATUS] == whole.documents[Kind.STATUS]


def test_the_last_window_is_that_of_the_map(feed: DriveFeed, folder: Path) -> None:
    """Occupancy, what was measured and when cells were seen, against a pipeline of its own at the same moment."""
    drive = find_drive(folder, None)
    config = load_config(drive.config)
    pipeline = Pipeline(config, drive.config)
    seen = played(feed)
    last = next(update for update in pipeline.updates(Log(drive.log).batches()) if update.ego.stamp_ns == seen.pose[0])
    row, column, log_odds = pipeline.mapper.map.around(last.ego.odom_from_base, 200)
    np.testing.assert_array_equal(seen.cells(Plane.OCCUPANCY, row, column, 200, 200, -1), occupancy_percent(log_odds))
    assert seen.pose[1:4] == (last.ego.odom_from_base.x, last.ego.odom_from_base.y, last.ego.odom_from_base.yaw)
    stamp_ns, places, radars, verdicts = seen.points
    assert stamp_ns == last.ego.stamp_ns
    np.testing.assert_allclose(places, last.ego.odom_from_base.apply(last.judged.near()[0]), atol=1e-3)
    static = last.ego.odom_from_base.apply(last.static_points)
    np.testing.assert_allclose(places[verdicts == Judged.STATIC], static, atol=1e-3)
    assert set(radars.tolist()) <= {0, 2, 3}


def test_a_radar_that_falls_silent_is_named_with_its_reason(feed: DriveFeed) -> None:
    status = played(feed).documents[Kind.STATUS]
    assert status["state"] == "degraded"
    levels = {part["name"]: (part["level"], part["said"]) for part in status["parts"]}
    level, said = levels["radar front_right"]
    assert level == 1
    assert said.startswith("silent for")
    assert levels["radar front_left"] == (0, "ok")


def test_what_was_recorded_is_shown_as_it_was_published(feed: DriveFeed, folder: Path, tmp_path: Path) -> None:
    replay(find_drive(folder, None), tmp_path / "out", record=tmp_path / "drive.mcap")
    recorded = McapFeed(tmp_path / "drive.mcap")
    recorded.run(threading.Event())
    told, mapped = played(recorded), played(feed)
    assert told.documents[Kind.HELLO]["radars"] == mapped.documents[Kind.HELLO]["radars"]
    assert told.pose == mapped.pose
    for ours, theirs in zip(told.points, mapped.points, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-5)  # float32 in base, then in odom
    row, column = round(told.pose[2] / (30 / 128)), round(told.pose[1] / (30 / 128))
    window = (row - 100, column - 100, 200, 200, -1)
    np.testing.assert_array_equal(told.cells(Plane.OCCUPANCY, *window), mapped.cells(Plane.OCCUPANCY, *window))


def test_torn_and_foreign_recordings_end_in_one_sentence(folder: Path, tmp_path: Path) -> None:
    replay(find_drive(folder, None), tmp_path / "out", record=tmp_path / "drive.mcap")
    data = (tmp_path / "drive.mcap").read_bytes()
    for name, content, sentence in (
        ("torn", data[: len(data) * 2 // 3], "ends within a record|was not closed"),
        ("noise", b"noise" * 100, "not an MCAP file"),
        ("empty", data[:8] + b"\x0f" + (4).to_bytes(8, "little") + bytes(4), "holds no map of echogrid"),
    ):
        (tmp_path / f"{name}.mcap").write_bytes(content)
        with pytest.raises(EchogridError, match=f"{name}.mcap: .*({sentence})"):
            McapFeed(tmp_path / f"{name}.mcap").run(threading.Event())


def test_a_torn_log_is_complete_as_far_as_it_goes_and_one_without_a_map_says_so(folder: Path, tmp_path: Path) -> None:
    lines = (folder / "can.log").read_text().splitlines(keepends=True)
    for name, kept, sentence in (
        ("torn", lines[:2000], "noise"),
        ("other", ["(1.0) can0 7AA#00\n"], "noise'; none of its 1 frames .* ids 0x7AA "),
    ):
        (tmp_path / f"{name}.log").write_text("".join(kept) + "noise\n")
        show = TapeShow(DriveFeed(find_drive(tmp_path / f"{name}.log", folder / "echogrid.toml"), "analytic"))
        with pytest.raises(EchogridError, match=f"{name}.log: 1 of its parts .*{sentence}"):
            show.work(threading.Event())
        assert (show.feed.tape.done, bool(show.feed.tape.end)) == (1.0, name == "torn")


KEPT = {"motion alone": range(0x300), "radars alone": range(0x300, 0x400), "strangers": range(0), "another channel": range(0x400)}


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("motion alone", "drive.log: no map came of it: it has 0 complete scans and "),
        ("radars alone", " complete scans and 0 frames of ego motion"),
        ("strangers", "drive.log: none of its 1 frames is one that "),
        ("another channel", "give log_channel = \"can7\" to the bus 'can0'"),
        ("frames alone", "nothing was published on /echogrid/map; with -c echogrid.toml the CAN frames in it are mapped"),
        ("a status alone", "nothing was published on /echogrid/map; its last status is stale; radar front: silent"),
        ("a status of another make", "its last status is ?[2Jlost"),
        ("nothing", "drive.mcap: holds no map of echogrid: nothing was published on /echogrid/map"),
    ],
)
def test_a_page_of_a_recording_without_a_map_says_what_is_missing(kind: str, sentence: str, folder: Path, tmp_path: Path) -> None:
    """And which recording it is: it waits for no connection."""
    stranger = can.Message(arbitration_id=0x7AA, is_extended_id=False, channel="can0", timestamp=1.0)
    feed: DriveFeed | McapFeed
    if kind in KEPT:
        with can.CanutilsLogWriter(tmp_path / "drive.log") as writer:
            for message in [stranger, *Log(folder / "can.log")]:
                if message is stranger or message.arbitration_id in KEPT[kind]:
                    message.channel = "can7" if kind == "another channel" else "can0"
                    writer.on_message_received(message)
        feed = DriveFeed(find_drive(tmp_path / "drive.log", folder / "echogrid.toml"), "analytic")
    else:
        with McapWriter(tmp_path / "drive.mcap") as recording:
            if kind == "frames alone":
                recording.frame("can0", stranger)
            if kind == "a status of another make":
                recording.put(Message(STATUS, b'{"state": "\\u001b[2Jlost", "reasons": 5}', 1, 0, 0))
            if kind == "a status alone":
                recording.put(Message(STATUS, json.dumps(status("stale", "radar front: silent")).encode(), 1, 0, 0))
        feed = McapFeed(tmp_path / "drive.mcap")
    show, seen = TapeShow(feed), Seen()
    with pytest.raises(EchogridError):
        show.work(threading.Event())
    with served(Ready(feed)) as (_, port), watch(port) as viewer:
        while Kind.CLOCK not in seen.documents:
            seen.take(viewer.recv(timeout=60))
    assert seen.documents[Kind.HELLO]["name"] in ("drive.log", "drive.mcap")
    assert sentence in seen.documents[Kind.CLOCK]["failure"]
    assert "\n" not in seen.documents[Kind.CLOCK]["failure"]


def test_a_viewer_plays_seeks_and_pauses(feed: DriveFeed) -> None:
    with served(Ready(feed)) as (_, port), watch(port, {"speed": 16.0}) as viewer, watch(port, {"playing": False, "seek": 2.0}) as other:
        seen = Seen()
        while Kind.CLOCK not in seen.documents or seen.documents[Kind.CLOCK]["at"] < feed.tape.end:
            seen.take(viewer.recv(timeout=60))
        ended = played(feed)
        assert seen.pose == ended.pose
        assert all(np.array_equal(seen.blocks[key], cells) for key, cells in ended.blocks.items())
        viewer.send(json.dumps({"seek": 3.0, "playing": False}))
        while seen.documents[Kind.CLOCK]["at"] != 3.0:
            seen.take(viewer.recv(timeout=60))
        assert not seen.documents[Kind.CLOCK]["playing"]
        paused = Seen()
        while Kind.CLOCK not in paused.documents:
            paused.take(other.recv(timeout=60))
        clock = paused.documents[Kind.CLOCK]
        assert (clock["at"], clock["playing"]) == (2.0, False)  # each has a time of its own


def test_a_stored_map_is_shown_whole(dense: tuple[np.ndarray, int, int], tmp_path: Path, folder: Path) -> None:
    replay(find_drive(folder, None), tmp_path / "out", store=tmp_path / "map.egmap")
    percent, row, column = dense
    for path in (tmp_path / "map.egmap", tmp_path / "out" / "map.npz"):
        with served(MapShow(stored_scene(path, None))) as (_, port), watch(port) as viewer:
            seen = Seen()
            while Kind.TRAIL not in seen.kinds:
                seen.take(viewer.recv(timeout=60))
        np.testing.assert_array_equal(seen.cells(Plane.OCCUPANCY, row, column, *percent.shape, -1), percent)
    with pytest.raises(EchogridError, match="epoch 7 is not there"):
        stored_scene(tmp_path / "map.egmap", 7)
