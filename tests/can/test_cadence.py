"""A counter against a period: lost frames are told from time that jumped, whatever the counter's size."""

from __future__ import annotations

import random

from hypothesis import assume, given
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
