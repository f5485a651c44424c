"""When the buses are looked at. What is waited for here comes about however busy the machine is."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from tests.support.waiting import PATIENCE

from echogrid.can.bus import GATHER
from echogrid.live import pace as module
from echogrid.live.pace import DRIFT, LONGEST, Pace

AGES = 1000.0  # s: longer than any test waits


@contextmanager
def waiting(pace: Pace, *buses: str) -> Iterator[list[threading.Thread]]:
    """Threads with a frame in hand, of which each ends when its bus is to be read."""
    threads = [threading.Thread(target=pace.wait, args=(bus,), daemon=True) for bus in buses]
    for thread in threads:
        thread.start()
    yield threads
    for thread in threads:
        thread.join(PATIENCE)
        assert not thread.is_alive()


def looked(pace: Pace, *buses: str) -> None:
    """A look at these, which finds something."""
    with waiting(pace, *buses):
        pass
    for bus in buses:
        pace.looked(bus, again=False)


def test_after_a_look_it_rests_until_all_is_mapped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BUSY", AGES)
    pace = Pace()
    looked(pace, "can0")
    with waiting(pace, "can0") as (thread,):
        thread.join(0.05)
        assert thread.is_alive()
        now = time.monotonic()
        pace.resume(newest=500.0, looked_at=now, expected=500.0)
        thread.join(PATIENCE)


def test_it_rests_while_no_cycle_can_end_but_not_for_a_slow_mapping(monkeypatch: pytest.MonkeyPatch) -> None:
    pace = Pace()
    looked(pace, "can0")
    with waiting(pace, "can0"):  # nothing is ever mapped
        pass
    monkeypatch.setattr(module, "LONGEST", AGES)
    looked(pace, "can0")
    pace.resume(newest=500.0, looked_at=time.monotonic(), expected=500.0 + AGES / 2)
    pace.looked("can1", again=True)  # a bus where nothing came says nothing of the others
    with waiting(pace, "can0") as (thread,):
        thread.join(0.05)
        assert thread.is_alive()
        pace.resume(newest=500.0, looked_at=time.monotonic(), expected=499.0)


def test_it_rests_no_longer_than_buffers_hold() -> None:
    pace = Pace()
    looked(pace, "can0")
    pace.resume(newest=500.0, looked_at=time.monotonic(), expected=500.0 + AGES)
    looked(pace, "can0")


def test_after_a_look_that_found_nothing_or_not_all_it_does_not_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BUSY", AGES)
    pace = Pace()
    with waiting(pace, "can0"):
        pass
    pace.looked("can0", again=True)
    looked(pace, "can0")


def test_a_recording_faster_than_it_was_made_is_never_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BUSY", AGES)
    pace = Pace()
    pace.rests = False
    monkeypatch.setattr(module, "LONGEST", AGES)
    for _ in range(3):
        looked(pace, "can0")
        pace.resume(newest=500.0, looked_at=time.monotonic(), expected=900.0)
    assert pace.came_at(500.0, 1000.0) == 1000.0 - GATHER


def test_all_buses_with_frames_are_read_in_one_look(monkeypatch: pytest.MonkeyPatch) -> None:
    """And the mapping waits until they are."""
    monkeypatch.setattr(module, "BUSY", AGES)
    pace = Pace()
    looked(pace, "can0")
    with waiting(pace, "can0", "can1", "can2"):
        while len(pace._waiting) < 3:
            time.sleep(0.001)
        pace.resume(newest=500.0, looked_at=time.monotonic(), expected=0.0)
    monkeypatch.setattr(module, "GATHER", AGES)
    mapping = threading.Thread(target=pace.settle, daemon=True)
    mapping.start()
    for bus in ("can2", "can0"):
        pace.looked(bus, again=False)
    mapping.join(0.05)
    assert mapping.is_alive()
    pace.looked("can1", again=False)
    mapping.join(PATIENCE)
    assert not mapping.is_alive()


def test_when_a_frame_came_is_known_from_those_that_did_not_wait() -> None:
    """Frames stamped 100 s behind our clock, read 0 to 20 ms after they came."""
    pace = Pace()
    for n in range(50):
        pace.resume(newest=n * 0.05, looked_at=n * 0.05 + 100.0 + n * 7 % 21 * 1e-3, expected=0.0)
    assert pace.came_at(3.0, 103.02) == pytest.approx(103.0, abs=50 * DRIFT)
    assert pace.came_at(3.0, 102.99) == 102.99  # not after it was read
    assert pace.came_at(2.0, 103.02) == pytest.approx(103.02 - LONGEST)  # nor longer before than it can have waited
    pace.resume(newest=2000.0, looked_at=103.0, expected=0.0)  # the other clock was set
    assert pace.came_at(2000.01, 103.02) == pytest.approx(103.01)
