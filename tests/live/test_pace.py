"""When the buses are looked at."""

from __future__ import annotations

import time

import pytest

from echogrid.can.bus import GATHER
from echogrid.live.pace import DRIFT, LONGEST, Pace


@pytest.fixture
def rested(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """How long each rest was, none of which takes any time."""
    rests = list[float]()
    monkeypatch.setattr(time, "sleep", rests.append)
    return rests


def test_it_rests_until_a_cycle_may_end(rested: list[float]) -> None:
    """By the traffic's clock, which lies 500 s behind ours."""
    pace = Pace()
    assert not pace.rest()  # nothing is known yet
    assert rested == []
    now = time.monotonic()
    pace.mapped(newest=now - 500.0, looked_at=now, expected=now - 500.0 + 0.03)
    assert pace.rest()
    assert rested == [pytest.approx(0.03, abs=0.02)]
    assert rested[0] <= 0.03 + GATHER


def test_it_does_not_rest_once_a_cycle_may_have_ended(rested: list[float]) -> None:
    pace, now = Pace(), time.monotonic()
    pace.mapped(newest=500.0, looked_at=now, expected=499.9)
    assert not pace.rest()
    assert rested == []


def test_it_rests_no_longer_than_buffers_hold(rested: list[float]) -> None:
    pace, now = Pace(), time.monotonic()
    pace.mapped(newest=500.0, looked_at=now, expected=1500.0)
    assert pace.rest()
    assert rested[0] <= LONGEST


def test_a_recording_faster_than_it_was_made_is_never_waited_for(rested: list[float]) -> None:
    pace = Pace()
    pace.rests = False
    pace.mapped(newest=500.0, looked_at=time.monotonic(), expected=900.0)
    assert not pace.rest()
    assert rested == []
    assert pace.came_at(500.0, 1000.0) == 1000.0 - GATHER


def test_when_a_frame_came_is_known_from_those_that_did_not_wait() -> None:
    """Frames stamped 100 s behind our clock, read 0 to 20 ms after they came."""
    pace = Pace()
    for n in range(50):
        pace.mapped(newest=n * 0.05, looked_at=n * 0.05 + 100.0 + n * 7 % 21 * 1e-3, expected=0.0)
    assert pace.came_at(3.0, 103.02) == pytest.approx(103.0, abs=50 * DRIFT)
    assert pace.came_at(3.0, 102.99) == 102.99  # not after it was read
    assert pace.came_at(2.0, 103.02) == pytest.approx(103.02 - LONGEST)  # nor longer before than it can have waited
    pace.mapped(newest=2000.0, looked_at=103.0, expected=0.0)  # the other clock was set
    assert pace.came_at(2000.01, 103.02) == pytest.approx(103.01)
