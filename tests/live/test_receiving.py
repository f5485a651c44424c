"""Reading the buses: by the thread that maps, and by the guard where that takes too long."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from types import SimpleNamespace

import can
import numpy as np
import pytest
from tests.support.frames import frame
from tests.support.waiting import until

from echogrid.can.bus import MOST
from echogrid.can.frame_queue import Item
from echogrid.can.intake.frames import FrameBatch
from echogrid.config.tables import Bus
from echogrid.live.receiving import Receiving

NAMES = ("receiving-a", "receiving-b")


@pytest.fixture
def receiving() -> Iterator[Receiving]:
    """Of two virtual buses."""
    signals = SimpleNamespace(are_motion=lambda bus, batch: np.zeros(len(batch), bool), ids=lambda bus: [(0x100, False)])
    with ExitStack() as opened:
        found = Receiving(signals)  # type: ignore[arg-type]
        found.open(tuple(Bus(name=name, interface="virtual", channel=name) for name in NAMES), opened)
        yield found


@pytest.fixture
def senders() -> Iterator[list[can.BusABC]]:
    with ExitStack() as opened:
        yield [opened.enter_context(can.Bus(interface="virtual", channel=name, preserve_timestamps=True)) for name in NAMES]


@pytest.fixture
def guarded(receiving: Receiving) -> Iterator[Receiving]:
    stop = threading.Event()
    thread = threading.Thread(target=receiving.guard, args=(stop,))
    thread.start()
    yield receiving
    stop.set()
    thread.join()


def stamps(items: list[Item]) -> list[float]:
    return sorted(stamp for _, batch, _ in items for stamp in batch.stamps.tolist())


def test_a_look_finds_what_all_buses_have(receiving: Receiving, senders: list[can.BusABC]) -> None:
    assert receiving.look(0.0) == []
    for n in range(6):
        senders[n % 2].send(frame(0x100, b"", float(n)))
    found = list[float]()
    until(lambda: len(found) == 6, lambda: found.extend(stamps(receiving.look(0.05))))
    assert sorted(found) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert receiving.look(0.0) == []


def test_more_than_one_look_takes_is_taken_without_a_rest(receiving: Receiving, senders: list[can.BusABC]) -> None:
    for n in range(2 * MOST + 1):
        senders[0].send(frame(0x100, b"", float(n)))
    first = until(lambda: receiving.look(0.05))
    assert len(stamps(first)) == MOST
    receiving.pace.rest = lambda: pytest.fail("there is no time to rest")  # type: ignore[method-assign]
    assert len(stamps(receiving.look(0.05))) == MOST
    assert len(stamps(receiving.look(0.05))) == 1


def test_while_one_look_is_mapped_for_long_the_guard_reads(guarded: Receiving, senders: list[can.BusABC]) -> None:
    """And its frames are the next look's, with the time when they were read."""
    senders[0].send(frame(0x100, b"", 1.0))
    assert stamps(until(lambda: guarded.look(0.05))) == [1.0]
    before = time.monotonic()
    senders[1].send(frame(0x100, b"", 2.0))
    until(lambda: len(guarded.queue) == 1)
    between = time.monotonic()
    ((_, batch, at),) = guarded.look(0.0)
    assert batch.stamps.tolist() == [2.0]
    assert before <= at <= between


def test_while_the_mapping_waits_the_guard_does_not_read(guarded: Receiving, senders: list[can.BusABC]) -> None:
    """Else a frame would lie in the queue, of which the waiting thread knows nothing."""
    put, readers = guarded.queue.put, set[threading.Thread]()

    def noted(bus: str, batch: FrameBatch, read_at: float) -> None:
        readers.add(threading.current_thread())
        put(bus, batch, read_at)

    guarded.queue.put = noted  # type: ignore[method-assign]
    timer = threading.Timer(0.3, senders[0].send, (frame(0x100, b"", 1.0),))
    timer.start()
    assert stamps(until(lambda: guarded.look(0.5))) == [1.0]
    timer.join()
    assert readers == {threading.current_thread()}


def test_after_a_rest_what_is_there_is_taken_and_none_is_waited_for(guarded: Receiving, senders: list[can.BusABC]) -> None:
    """Frames have come meanwhile, and if none has the next look waits for one."""
    guarded.pace.rest = lambda: True  # type: ignore[method-assign]
    senders[0].send(frame(0x100, b"", 1.0))
    assert stamps(until(lambda: guarded.look(60.0))) == [1.0]
    began = time.monotonic()
    assert guarded.look(60.0) == []
    assert time.monotonic() - began < 60.0
