"""A counter against a period: lost frames are told from time that jumped, whatever the counter's size."""

from __future__ import annotations

import random

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from echogrid.can.cadence import JUMP, Cadence

MS = 1_000_000


def settled(bits: int, period_ms: int) -> tuple[Cadence, int, int]:
    """With the number and the time (ms) of its last frame; the frames come up to 3 ms late."""
    cadence, late = Cadence(bits), random.Random(1)
    for n in range(100):
        cadence.add(n % (1 << bits), n * period_ms * MS + late.randrange(3 * MS))
        assert abs(cadence.lag) < JUMP / 10
    return cadence, 99, 99 * period_ms


@given(st.sampled_from([(4, 10), (8, 50), (2, 20)]), st.integers(0, 45))
def test_lost_frames_are_no_jump(kind: tuple[int, int], lost: int) -> None:
    bits, period = kind
    assume((1 + lost) * period < 950 and (1 + lost) % (1 << bits))  # the same number again is a repeated frame, and never gets here
    cadence, number, at = settled(bits, period)
    cadence.add((number + 1 + lost) % (1 << bits), (at + (1 + lost) * period) * MS)
    assert abs(cadence.lag) < JUMP / 2
    assert cadence.missing == lost % (1 << bits)


@given(st.sampled_from([(4, 10), (8, 50), (4, 20)]), st.integers(0, 2))
def test_two_frames_in_the_wrong_order_are_no_jump(kind: tuple[int, int], apart_ms: int) -> None:
    """Once a division by zero, which ended the service."""
    bits, period = kind
    cadence, number, at = settled(bits, period)
    for n, (ahead, late) in enumerate([(2, 0), (1, apart_ms), (3, period), (4, 2 * period)]):
        cadence.add((number + ahead) % (1 << bits), (at + 2 * period + late) * MS)
        assert abs(cadence.lag) < JUMP / 4
        assert cadence.missing == (1, 0, 1, 0)[n]


@given(st.integers(250, 900))
def test_time_that_jumped_stays_so_until_it_jumps_back_or_catches_up(jump: int) -> None:
    cadence, number, at = settled(8, 50)
    for n in range(1, 40):
        cadence.add(number + n, (at + 50 * n + jump) * MS)
        assert abs(cadence.lag - jump / 1e3) < 0.05
    while jump > 0:  # what has waited comes as a burst
        number, jump = number + 1, jump - 50
        cadence.add((number + 39) % 256, (at + 50 * 39 + 50 + max(jump, 0)) * MS)
        at += 50
    assert abs(cadence.lag) < JUMP / 2


def test_a_small_counter_sees_a_jump_that_is_no_multiple_of_its_round() -> None:
    for jump in range(230, 500, 10):
        cadence, number, at = settled(4, 10)
        cadence.add((number + 1) % 16, (at + 10 + jump) * MS)
        rest = jump // 10 % 16
        if rest == 0 or 3 <= rest <= 13:
            assert (abs(cadence.lag) < JUMP) == (rest == 0)


def test_after_a_long_silence_a_sender_may_begin_anywhere() -> None:
    cadence, _, at = settled(8, 50)
    cadence.add(200, (at + 2000) * MS)
    cadence.add(201, (at + 2050) * MS)
    assert abs(cadence.lag) < JUMP / 10


@given(st.sampled_from([(4, 10), (8, 50)]), st.sets(st.integers(0, 4), min_size=1, max_size=2), st.integers(1, 2))
def test_cycles_that_are_left_out_among_the_first_are_no_lag(kind: tuple[int, int], where: set[int], left_out: int) -> None:
    """The sender leaves them out without counting them: the period is that of most steps."""
    bits, period = kind
    cadence, at = Cadence(bits), 0
    for n in range(60):
        at += period * (1 + left_out if n - 1 in where else 1)
        cadence.add(n % (1 << bits), at * MS)
        assert abs(cadence.lag) < 0.03


def batched(seed: int, period_ms: float, seconds: float, longest: float) -> list[tuple[int, int]]:
    """Frames (number, ns) as a loaded machine stamps them: when it wakes up, every 10 ms or so, and now and then not for `longest` s."""
    rng = random.Random(seed)
    frames, wake = [], 0.0
    for n in range(int(seconds * 1e3 / period_ms)):
        sent = n * period_ms * 1e-3
        waited = 0
        while wake < sent:
            wake += rng.expovariate(100.0) + (rng.uniform(0.05, longest) if rng.random() < 0.01 else 0.0)
            waited = 0
        frames.append((n, round((wake + waited * 3e-5) * 1e9)))
        waited += 1
    return frames


@given(st.integers(0, 1000), st.sampled_from([(4, 10.0), (8, 50.0), (4, 20.0), (8, 100.0)]), st.floats(0.1, 0.45))
@settings(max_examples=60, deadline=None)
def test_stalls_of_who_stamps_the_frames_leave_no_lag(seed: int, kind: tuple[int, float], longest: float) -> None:
    """What has waited comes at once, and from then on there is no lag; "left out" and "gone round" were wrong guesses."""
    bits, period = kind
    cadence = Cadence(bits)
    lags, late_ns = [], []
    for number, ns in batched(seed, period, 20.0, longest):
        cadence.add(number % (1 << bits), ns)
        lags.append(cadence.lag)
        late_ns.append(ns - number * period * MS)
    caught_up = [lag for lag, late in zip(lags[len(lags) // 2 :], late_ns[len(lags) // 2 :], strict=True) if late < 30 * MS]
    assert len(caught_up) > 10
    assert sum(abs(lag) > 0.1 for lag in caught_up) < 0.05 * len(caught_up)


@given(st.sampled_from([10, 20, 50, 100]), st.integers(0, 30))
@settings(max_examples=40, deadline=None)
def test_a_stall_among_the_first_frames_does_not_settle_the_period(period: int, waiting: int) -> None:
    """The first `waiting` frames come at once; the period is learned all the same."""
    cadence = Cadence(8)
    for n in range(round(8000 / period)):
        cadence.add(n % 256, max(n, waiting) * period * MS + n * 1000)
    assert abs(cadence.lag) < JUMP / 4
    cadence.add(round(8000 / period) % 256, (8000 + 450) * MS)
    assert abs(cadence.lag - 0.45) < JUMP / 4
