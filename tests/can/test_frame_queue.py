"""The queue between buses and mapping under overload."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from tests.support.frames import frame

from echogrid.can.frame_queue import FrameQueue
from echogrid.can.intake.frames import FrameBatch


def queue(limit: int) -> FrameQueue:
    return FrameQueue(limit, lambda bus, batch: batch.ids < 0x200)


def one(number: int, data: bytes = b"") -> FrameBatch:
    return FrameBatch.of([frame(number, data, 0.0)])


def drain(frames: FrameQueue) -> list[int]:
    return [number for _, batch, _ in frames.take(10_000) for number in batch.ids.tolist()]


def test_in_order_and_then_empty() -> None:
    frames = queue(10)
    for number in (0x100, 0x300, 0x301):
        frames.put("can0", one(number), 0.0)
    assert drain(frames) == [0x100, 0x300, 0x301]
    assert frames.take(1) == []
    assert len(frames) == 0


def test_what_came_together_is_taken_together_and_no_more_than_that_beyond_what_is_asked_for() -> None:
    frames = queue(20)
    for first in (0x100, 0x110, 0x120):
        frames.put("can0", FrameBatch.of([frame(first + n, b"", 0.0) for n in range(3)]), 0.0)
    assert [len(batch) for _, batch, _ in frames.take(4)] == [3, 3]
    assert len(frames) == 3
    assert drain(frames) == [0x120, 0x121, 0x122]


def test_full_it_drops_the_radar_frames_of_its_older_half_and_never_motion() -> None:
    frames = queue(6)
    for number in (0x100, 0x300, 0x301, 0x302, 0x303, 0x101, 0x304):
        frames.put("can0", one(number), 0.0)
    assert frames.dropped == 2
    assert drain(frames) == [0x100, 0x302, 0x303, 0x101, 0x304]


@given(st.lists(st.booleans(), max_size=300), st.integers(2, 20), st.integers(1, 9))
def test_what_stays_is_in_order_and_all_motion_is_there(kinds: list[bool], limit: int, together: int) -> None:
    frames = queue(limit)
    numbers = [(0x000 if motion else 0x200) + min(index, 0x1FF) for index, motion in enumerate(kinds)]
    for at in range(0, len(numbers), together):
        frames.put("can0", FrameBatch.of([frame(number, b"", 0.0) for number in numbers[at : at + together]]), 0.0)
    assert len(frames) <= 5 * limit + 2 * together
    got = drain(frames)
    assert sorted(got, key=numbers.index) == got
    motion = [number for number in numbers if number < 0x200]
    kept = [number for number in got if number < 0x200]
    assert kept == motion[frames.dropped_motion :]
    assert len(numbers) == len(got) + frames.dropped + frames.dropped_motion


def test_a_player_that_is_always_too_fast_costs_whole_scans_and_leaves_whole_ones() -> None:
    """Scans of 8 frames, two put for each frame taken: of those taken most scans are complete."""
    frames, taken = queue(128), []
    for cycle in range(200):
        for slot in range(8):
            frames.put("can0", one(0x200 + slot, bytes((cycle,))), 0.0)
            if slot % 2:
                ((_, batch, _),) = frames.take(1)
                taken.append(int(batch.data[0]))
    counts = [taken.count(cycle) for cycle in set(taken)]
    assert frames.dropped > 500
    assert counts.count(8) > 0.8 * len(counts)
