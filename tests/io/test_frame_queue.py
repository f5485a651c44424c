"""The queue between buses and mapping under overload."""

from __future__ import annotations

import threading

from tests.frames import frame

from echogrid.io.frame_queue import FrameQueue


def queue(limit: int) -> FrameQueue:
    return FrameQueue(limit, lambda bus, message: message.arbitration_id < 0x200)


def drain(frames: FrameQueue) -> list[int]:
    got = []
    while (item := frames.get(timeout=0.0)) is not None:
        got.append(item[1].arbitration_id)
    return got


def test_in_order_and_empty_is_none() -> None:
    frames = queue(10)
    for number in (0x100, 0x300, 0x301):
        frames.put("can0", frame(number, b"", 0.0))
    assert drain(frames) == [0x100, 0x300, 0x301]


def test_full_it_drops_the_oldest_radar_frame_and_never_motion() -> None:
    frames = queue(4)
    for number in (0x100, 0x300, 0x101, 0x301, 0x302, 0x102, 0x103, 0x104):
        frames.put("can0", frame(number, b"", 0.0))
    assert frames.dropped == 3
    assert drain(frames) == [0x100, 0x101, 0x102, 0x103, 0x104]


def test_a_waiting_reader_is_woken() -> None:
    frames = queue(4)
    timer = threading.Timer(0.05, frames.put, ("can0", frame(0x300, b"", 0.0)))
    timer.start()
    item = frames.get(timeout=10.0)
    timer.join()
    assert item is not None
