"""Labels by hindsight, beside counts made cell by cell."""

from __future__ import annotations

import math

import numpy as np

from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid_training.evaluation.recorded.drive import Reflections
from echogrid_training.evaluation.recorded.scores import Rectangle
from echogrid_training.own.hindsight import AGREE, CLEAR, PASSED, SHORT, judge

CELL = 0.25
WHERE = Rectangle(-40, -40, 80, 80, CELL)
FAR = [EgoState(0, SE2(-7.0, -7.0, 0.0), 0.0, 0.0)]  # a car that stands in a corner


def look(x: float, y: float, *ends: tuple[float, float]) -> Reflections:
    away = np.array(ends) - (x, y)
    return Reflections(np.array((x, y)), np.hypot(*away.T), np.arctan2(away[:, 1], away[:, 0]))


def at(label: np.ndarray, x: float, y: float) -> int:
    return int(label[math.floor(y / CELL) + 40, math.floor(x / CELL) + 40])


def test_several_looks_make_it_occupied_one_does_not() -> None:
    label = judge([look(0, 0, (5.1, 0.1)), look(0, 1, (5.1, 0.1)), look(0, 0, (0.1, 5.1))], FAR, WHERE).label
    assert at(label, 5.1, 0.1) == 1
    assert at(label, 0.1, 5.1) == 0


def test_random_looks_as_counted_cell_by_cell() -> None:
    rng = np.random.default_rng(4)
    looks = [look(*rng.uniform(-2, 2, 2), *rng.uniform(-8, 8, (6, 2))) for _ in range(12)]
    ended, passed = np.zeros((80, 80)), np.zeros((80, 80))
    for one in looks:
        hit, through = set(), set()
        for (x, y), length, bearing in zip(one.points, one.range, one.bearing, strict=True):
            hit.add((math.floor(y / CELL) + 40, math.floor(x / CELL) + 40))
            step = SHORT
            while step < length - SHORT:
                px, py = one.origin + step * np.array((math.cos(bearing), math.sin(bearing)))
                through.add((math.floor(py / CELL) + 40, math.floor(px / CELL) + 40))
                step += CELL
        for cell in hit:
            ended[cell] += 1
        for cell in through:
            passed[cell] += 1
    label = judge(looks, FAR, WHERE).label
    for row in range(3, 77):
        for column in range(3, 77):
            around = ended[row - 1 : row + 2, column - 1 : column + 2].sum()
            near = ended[row - CLEAR : row + CLEAR + 1, column - CLEAR : column + CLEAR + 1].any()
            free = passed[row, column] >= PASSED and not near
            expected = -1 if free else int(ended[row, column] > 0 and around >= AGREE)
            if row * CELL > 8 or column * CELL > 8:  # the car's corner is free besides
                assert label[row, column] == expected


def test_where_the_car_drove_is_free() -> None:
    driven = [EgoState(0, SE2(x, 0.0, 0.0), 5.0, 0.0) for x in np.arange(-3.0, 3.0, 0.2)]
    label = judge([], driven, WHERE).label
    assert at(label, 0.0, 0.0) == -1
    assert at(label, 0.0, 3.0) == 0
    assert (label <= 0).all()
