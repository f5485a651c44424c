"""The traffic's time: a stray frame moves nothing, a pause and a clock that was set are followed."""

from __future__ import annotations

from echogrid.can.intake.traffic_time import AHEAD_FOR, BACK_FOR_NS, TrafficTime

S, STEP = 1_000_000_000, 5_000_000


def fed(time: TrafficTime, first_ns: int, count: int) -> list[bool]:
    """Frames every 5 ms."""
    return [time.takes(first_ns + n * STEP) for n in range(count)]


def test_frames_out_of_order_are_ordinary() -> None:
    time = TrafficTime()
    assert all(time.takes(ns) for ns in (5 * S, 5 * S - S // 2, 6 * S, 5 * S + 1))
    assert time.newest_ns == 6 * S


def test_strays_move_nothing() -> None:
    time = TrafficTime()
    for n in range(100):
        assert time.takes(100 * S + n * STEP)
        assert not time.takes((3700 if n % 2 else 5) * S)
    assert (time.newest_ns, time.set_back, time.waiting_ns) == (100 * S + 99 * STEP, 0, 0)


def test_after_a_pause_the_first_few_wait_for_one_another() -> None:
    time = TrafficTime()
    fed(time, 100 * S, 10)
    assert fed(time, 130 * S, 8) == [False] * (AHEAD_FOR - 1) + [True] * (9 - AHEAD_FOR)
    assert time.set_back == 0


def test_a_clock_that_was_set_back_is_followed_after_a_second() -> None:
    time = TrafficTime()
    fed(time, 4000 * S, 10)
    refused = BACK_FOR_NS // STEP
    assert fed(time, 400 * S, refused + 5) == [False] * refused + [True] * 5
    assert (time.set_back, time.newest_ns) == (1, 400 * S + (refused + 4) * STEP)
