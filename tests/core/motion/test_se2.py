"""Transforms and arcs against identities and small steps."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from echogrid.core.motion.se2 import IDENTITY, SE2, arc

metres = st.floats(-1000, 1000)
angles = st.floats(-10, 10)
poses = st.builds(SE2, metres, metres, angles)


def _close(one: SE2, other: SE2, tolerance: float = 1e-6) -> bool:
    return math.hypot(one.x - other.x, one.y - other.y) < tolerance and abs(one.yaw - other.yaw) < tolerance


@given(poses)
def test_a_transform_and_its_inverse_cancel(a_from_b: SE2) -> None:
    assert _close(a_from_b @ a_from_b.inverse(), IDENTITY)
    assert _close(a_from_b.inverse() @ a_from_b, IDENTITY)


@given(poses, poses, st.tuples(metres, metres))
def test_composing_is_applying_one_after_the_other(a_from_b: SE2, b_from_c: SE2, point: tuple[float, float]) -> None:
    c = np.array([point])
    np.testing.assert_allclose((a_from_b @ b_from_c).apply(c), a_from_b.apply(b_from_c.apply(c)), atol=1e-6)


def test_a_quarter_turn_to_the_left_ends_ahead_and_left() -> None:
    """A circle of radius 10 m: a quarter of it is 5 pi m long and ends at (10, 10), looking along +y."""
    end = arc(5 * math.pi, math.pi / 2)
    assert _close(end, SE2(10.0, 10.0, math.pi / 2), 1e-9)


@given(st.floats(-20, 20), st.floats(-3, 3))
def test_an_arc_is_many_small_straight_steps(distance: float, turn: float) -> None:
    steps = 4000
    pose = IDENTITY
    for _ in range(steps):  # the midpoint rule: second order in the step
        pose = pose @ SE2(0, 0, turn / steps / 2) @ SE2(distance / steps, 0, 0) @ SE2(0, 0, turn / steps / 2)
    assert _close(arc(distance, turn), pose, 1e-5)


@given(st.floats(-20, 20), st.floats(1e-5, 3e-4))
def test_the_series_for_small_turns_joins_the_formula(distance: float, turn: float) -> None:
    """Two halves of an arc make the whole, whichever of the two branches each falls into."""
    half = arc(distance / 2, turn / 2)
    assert _close(half @ half, arc(distance, turn), 1e-9)


@given(st.floats(-9.9e-5, 9.9e-5).filter(lambda turn: abs(turn) > 1e-9))
def test_the_series_is_the_arc_to_the_last_digits(turn: float) -> None:
    """By 1 - cos(t) = 2 sin²(t / 2), which loses none."""
    end = arc(7.0, turn)
    np.testing.assert_allclose((end.x, end.y), (7.0 * math.sin(turn) / turn, 14.0 * math.sin(turn / 2) ** 2 / turn), rtol=1e-14)
