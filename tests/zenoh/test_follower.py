"""Key frames and updates of a whole drive, much of which gets lost: what is put together from them is the map, cell by cell."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
import numpy as np
import pytest
from tests.support.places import DEMO

from echogrid.config.loading import load_config
from echogrid.core.map.map_delta import Rectangle, around
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.topics.announcer import Announcer, Snapshots, occupancy_percent
from echogrid.topics.grids import Grid, GridUpdate, decode_grid, decode_update
from echogrid.topics.topic import FULL, KEY, UPDATE, Message
from echogrid.zenoh.follower import Follower, KeyName, MapName, Window

MARGIN = 64  # cells
CELL = 30.0 / 128  # m


@dataclass(frozen=True)
class Step:
    """What was announced at one time, and the map then, a good deal beyond the window."""

    messages: dict[str, Message]
    place: Rectangle
    occupancy: np.ndarray

    def fresh(self, origin: tuple[float, float], shape: tuple[int, int]) -> np.ndarray:
        """What a whole window of that origin shows."""
        row, column = round(origin[1] / CELL), round(origin[0] / CELL)
        return self.occupancy[Rectangle(row, column, *shape).within(self.place)]


def steps(epoch_at: int) -> Iterator[Step]:
    """Of the shipped drive; from step `epoch_at` on as if a new map had begun."""
    drive = find_drive(DEMO, None)
    config = load_config(drive.config, "analytic")
    config = msgspec.structs.replace(config, map=msgspec.structs.replace(config.map, cycle_ms=100.0))  # as often as is published
    pipeline = Pipeline(config, drive.config)
    announcer, snapshots = Announcer(config, ""), Snapshots()
    count = 0
    for update in pipeline.updates(Log(drive.log).batches()):
        snapshot = snapshots.take(pipeline.mapper, update, config.publish)
        if snapshot is not None:
            count += 1
            snapshot = msgspec.structs.replace(snapshot, epoch=int(count >= epoch_at))
            window = around(snapshot.update.ego.odom_from_base, CELL, 256)
            place = Rectangle(window.row - MARGIN, window.column - MARGIN, 256 + 2 * MARGIN, 256 + 2 * MARGIN)
            messages = {told.topic.name: told for told in announcer.map(snapshot)}
            yield Step(messages, place, occupancy_percent(pipeline.mapper.map.window(*place)))


@pytest.fixture(scope="module")
def drive() -> list[Step]:
    return list(steps(epoch_at=300))


class Receiver:
    """A follower at the end of a bad line, asked after every step; remembers how often it knew the newest map."""

    def __init__(self, seed: int, lost_updates: float, lost_keys: float) -> None:
        self.random = random.Random(seed)
        self.lost = {KEY.name: lost_keys, UPDATE.name: lost_updates}
        self.follower = Follower()
        self.last_key: tuple[KeyName, bytes] | None = None  # what the service keeps for whoever comes
        self.held: list[tuple[int, Window]] = []  # number of the step, what was claimed
        self.seen: set[int] = set()  # steps from which something came through

    def take(self, number: int, step: Step, source: bytes, *, connected: bool = True) -> None:
        for topic in (KEY, UPDATE):
            message = step.messages.get(topic.name)
            if message is None:
                continue
            name = KeyName(MapName(source, message.epoch), message.keyframe)
            if topic is KEY:
                self.last_key = (name, message.payload)
            if not connected or self.random.random() < self.lost[topic.name]:
                continue
            self.seen.add(number)
            if topic is KEY:
                self.follower.key(name, decode_grid(message.payload))
            else:
                self.follower.update(name, decode_update(message.payload))
        window = self.follower.window()
        if window is not None:
            self.held.append((number, window))

    def come_back(self, *, anew: bool) -> None:
        """Connects again; the service sends the key frame that it keeps. `anew`: as a program that was started again."""
        if anew:
            self.follower = Follower()
        if self.last_key is not None:
            self.follower.key(self.last_key[0], decode_grid(self.last_key[1]))


def check(receiver: Receiver, drive: list[Step]) -> int:
    """Every claim against the map at its stamp; how many steps were known at once."""
    at = {step.messages[FULL.name].stamp_ns: step for step in drive}
    known = 0
    for number, window in receiver.held:
        step = at[window.stamp_ns]
        assert window.map.epoch == step.messages[FULL.name].epoch
        np.testing.assert_array_equal(window.occupancy, step.fresh(window.origin, window.occupancy.shape))
        known += number in receiver.seen and step is drive[number]
    return known


def test_the_whole_window_is_the_map_around_the_car(drive: list[Step]) -> None:
    """What the rest is held against is what goes out as grid/fused/full."""
    for step in drive:
        grid = decode_grid(step.messages[FULL.name].payload)
        np.testing.assert_array_equal(grid.occupancy, step.fresh(grid.origin, grid.occupancy.shape))
    assert len(drive) > 700  # ten a second


def test_without_loss_every_step_is_known(drive: list[Step]) -> None:
    receiver = Receiver(0, 0.0, 0.0)
    for number, step in enumerate(drive):
        receiver.take(number, step, b"one")
    assert check(receiver, drive) == len(drive)
    sent = sum(len(message.payload) for step in drive for name, message in step.messages.items() if name in (KEY.name, UPDATE.name))
    whole = sum(len(step.messages[FULL.name].payload) for step in drive)
    assert sent < whole / 2


@pytest.mark.parametrize(("lost_updates", "lost_keys"), [(0.3, 0.0), (0.0, 0.5), (0.5, 0.5), (0.9, 0.9)])
@pytest.mark.parametrize("seed", range(3))
def test_whatever_is_lost_what_is_held_is_the_map_of_its_stamp(drive: list[Step], seed: int, lost_updates: float, lost_keys: float) -> None:
    receiver = Receiver(seed, lost_updates, lost_keys)
    for number, step in enumerate(drive):
        receiver.take(number, step, b"one")
    known = check(receiver, drive)
    # A step is known when it came through and so did the key frame that it needs: of every two seen about as many as key frames come.
    assert known > 0.8 * (1 - lost_keys) * len(receiver.seen)
    assert len({window.stamp_ns for _, window in receiver.held}) > 0.5 * known


@pytest.mark.parametrize("anew", [False, True])
def test_after_every_break_it_goes_on_with_the_map_of_then(drive: list[Step], anew: bool) -> None:
    receiver = Receiver(5, 0.1, 0.1)
    broken = False
    for number, step in enumerate(drive):
        if broken and receiver.random.random() < 0.2:
            broken = False
            receiver.come_back(anew=anew)
        elif not broken and receiver.random.random() < 0.05:
            broken = True
        receiver.take(number, step, b"one", connected=not broken)
    assert check(receiver, drive) > 0.7 * len(receiver.seen)


def test_a_service_that_was_started_anew_is_another_map(drive: list[Step]) -> None:
    """Epochs and key frames count from the beginning again; the second run's updates never change the first run's key frames."""
    first, second = drive[100:200], drive[:100]
    assert {step.messages[KEY.name].keyframe for step in first if KEY.name in step.messages} & set(range(1, 100))
    receiver = Receiver(7, 0.2, 0.6)
    for number, step in enumerate(first):
        receiver.take(number, step, b"one")
    for number, step in enumerate(second, len(first)):
        receiver.take(number, step, b"two")
    check(receiver, first + second)
    sources = [window.map.source for _, window in receiver.held]
    assert sources == sorted(sources)
    assert set(sources) == {b"one", b"two"}


def test_a_receiver_that_lays_updates_over_each_other_has_the_map_too(drive: list[Step]) -> None:
    """As RViz does: it never goes back to the key frame, and some updates are lost."""
    chance, cells, key = random.Random(3), np.zeros((0, 0), np.int8), None
    current = 0
    for step in drive:
        if KEY.name in step.messages:
            key = decode_grid(step.messages[KEY.name].payload)
            cells = key.occupancy.copy()
        elif chance.random() < 0.5:
            update = decode_update(step.messages[UPDATE.name].payload)
            height, width = update.occupancy.shape
            cells[update.y : update.y + height, update.x : update.x + width] = update.occupancy
        else:
            continue
        assert key is not None
        np.testing.assert_array_equal(cells, step.fresh(key.origin, cells.shape))
        current += 1
    assert current > len(drive) / 3


def test_key_frames_come_once_a_second_and_where_the_window_moves_or_a_map_begins(drive: list[Step]) -> None:
    before = None
    for step in drive:
        message = step.messages.get(KEY.name)
        if message is None:
            assert before is not None
            assert step.messages[UPDATE.name].stamp_ns - before.stamp_ns < 1e9
            assert (step.messages[UPDATE.name].keyframe, step.messages[UPDATE.name].epoch) == (before.keyframe, before.epoch)
            continue
        if before is not None:
            assert message.keyframe == before.keyframe + 1
            moved = decode_grid(message.payload).origin != decode_grid(before.payload).origin
            assert moved or message.epoch != before.epoch or message.stamp_ns - before.stamp_ns >= 1e9
        before = message


def test_an_update_beyond_its_key_frame_is_refused_and_the_next_taken() -> None:
    name = KeyName(MapName(bytes(16), 0), 1)
    follower = Follower()
    follower.key(name, Grid(1, "odom", 0.5, (0.0, 0.0), np.zeros((4, 4), np.int8)))
    follower.update(name, GridUpdate(2, "odom", 3, 0, np.ones((1, 2), np.int8)))
    with pytest.raises(ValueError, match="beyond its key frame"):
        follower.window()
    follower.update(name, GridUpdate(3, "odom", 2, 3, np.ones((1, 2), np.int8)))
    window = follower.window()
    assert window is not None
    assert window.stamp_ns == 3
    assert window.occupancy.sum() == 2
