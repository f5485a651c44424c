"""Turns laid on each other in a street whose walls are known."""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.motion.se2 import SE2, arc
from echogrid_training.labelling.matching import Matcher, lines

STREET = (((-20, 6), (40, 6)), ((-20, -5), (12, -5)), ((12, -5), (12, -9)), ((18, -9), (18, -5)), ((18, -5), (40, -5)), ((40, -5), (40, 6)))


def seen(pose: SE2, rng: np.random.Generator) -> np.ndarray:
    """Returns (N, 2) in base from all walls, no shadows, 2 cm of noise."""
    parts = []
    for begin, end in STREET:
        count = int(math.dist(begin, end) * 12)
        share = rng.uniform(size=(count, 1))
        parts.append(np.array(begin) * (1 - share) + np.array(end) * share)
    return pose.inverse().apply(np.concatenate(parts) + rng.normal(0.0, 0.02, (sum(map(len, parts)), 2)))


def test_dead_reckoning_that_errs_is_put_right() -> None:
    """4 % too fast, turning by 1.5°/s all the time: after 20 m a metre and 15° off, laid a few centimetres and 0.1°."""
    rng, matcher = np.random.default_rng(2), Matcher()
    true = reckoned = SE2(0.0, 0.0, 0.0)
    found = matcher.lay(reckoned, seen(true, rng))
    for _ in range(100):
        true = true @ arc(0.2, 0.0)
        reckoned = reckoned @ arc(0.208, math.radians(0.15))
        found = matcher.lay(reckoned, seen(true, rng))
    assert math.hypot(reckoned.x - true.x, reckoned.y - true.y) > 1.0
    assert math.hypot(found.x - true.x, found.y - true.y) < 0.12
    assert abs(math.degrees(found.yaw - true.yaw)) < 0.3


def test_where_nothing_stands_dead_reckoning_goes_on() -> None:
    matcher = Matcher()
    few = np.random.default_rng(1).uniform(-9, 9, (20, 2))
    for step in range(5):
        reckoned = SE2(step * 1.0, 0.1 * step, 0.02 * step)
        found = matcher.lay(reckoned, few)
        np.testing.assert_allclose((found.x, found.y, found.yaw), (reckoned.x, reckoned.y, reckoned.yaw), atol=1e-9)


def test_lines_go_through_walls_and_not_through_bushes() -> None:
    rng = np.random.default_rng(1)
    along = np.linspace(0, 10, 200)
    wall = np.stack((along * math.cos(0.3), along * math.sin(0.3)), axis=-1)
    normal, straight = lines(wall)
    assert straight.all()
    np.testing.assert_allclose(np.abs(normal @ (-math.sin(0.3), math.cos(0.3))), 1.0, atol=1e-6)
    assert lines(rng.normal(0.0, 1.0, (200, 2)))[1].mean() < 0.2
