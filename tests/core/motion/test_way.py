"""The way of a recording against the states that dead reckoning had, and what it takes of memory."""

from __future__ import annotations

import tracemalloc

import numpy as np

from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.core.motion.way import STEP_NS, Way

HOUR = 3600


def states(first: int, count: int, step_ns: int = 10_000_000) -> list[EgoState]:
    random = np.random.default_rng(first)
    return [EgoState(n * step_ns, SE2(*random.normal(size=3)), 1.0, 0.0) for n in range(first, first + count)]


def test_every_second_state_of_10_ms_is_kept_however_they_are_shown() -> None:
    """Odometry shows its last states again and again."""
    driven, way = states(0, 301), Way()
    for end in (1, 2, 5, 150, 150, 301):
        way.follow(driven[max(0, end - 200) : end])
    stamps, poses = way.arrays()
    wanted = driven[::2]
    assert stamps.tolist() == [state.stamp_ns for state in wanted]
    assert poses.tolist() == [[state.odom_from_base.x, state.odom_from_base.y, state.odom_from_base.yaw] for state in wanted]
    assert np.diff(stamps).min() >= STEP_NS
    way.clear()
    assert [len(part) for part in (way, *way.arrays())] == [0, 0, 0]
    assert way.arrays()[1].shape == (0, 3)


def test_an_hour_takes_a_few_megabytes() -> None:
    way, some = Way(), states(0, 50, STEP_NS)
    tracemalloc.start()
    for second in range(HOUR // 10):  # of every tenth
        way.follow([EgoState(state.stamp_ns + second * 10**9, state.odom_from_base, 1.0, 0.0) for state in some])
    taken = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert len(way) == HOUR // 10 * 50
    assert taken < 1e6
