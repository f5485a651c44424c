"""A map is judged beside the analytic one on every drive, and a map without a thought keeps no bound."""

from __future__ import annotations

import math

import pytest

from echogrid_training.evaluation.recorded.annotated import Scene
from echogrid_training.evaluation.recorded.comparison import Beside, DriveScores, MethodScores, beside
from echogrid_training.evaluation.recorded.scores import Free, Occupied


def scene(ap: float, occupied: int) -> Scene:
    return Scene(ap, occupied, 1000 - occupied, 1000, 0, 0, 0, 0.0, 0.0, 0.0, ((0.0,),), {}, {}, {})


def method(recall: float, false_free: float) -> MethodScores:
    return MethodScores(0.0, 100.0, 1.0, Occupied(0.0, 10.0, 0.1, recall, 0.0), Free(-2.2, 50.0, false_free), {})


def drive(mine: MethodScores, occupied: int = 20) -> DriveScores:
    methods = {"looks": mine, "analytic": method(0.5, 0.01)}
    return DriveScores("one", 100.0, 10.0, 100, methods, {"looks": scene(0.3, occupied), "analytic": scene(0.2, occupied)})


def test_it_is_ratios_and_a_difference() -> None:
    found = beside(drive(method(0.45, 0.03)), "looks")
    assert (found.ap, found.recall, found.false_free) == pytest.approx((1.5, 0.9, 0.02))
    assert beside(drive(method(0.46, 0.029)), "looks").kept


def test_too_few_occupied_cells_say_nothing_of_average_precision() -> None:
    assert math.isnan(beside(drive(method(0.5, 0.01), occupied=4), "looks").ap)
    assert not math.isnan(beside(drive(method(0.5, 0.01), occupied=5), "looks").ap)


@pytest.mark.parametrize(
    "one",
    [
        pytest.param(Beside(math.nan, 0.0, -0.01), id="an empty map finds nothing"),
        pytest.param(Beside(math.nan, math.nan, -0.01), id="nor does one beside another that finds nothing"),
        pytest.param(Beside(math.nan, 0.0, 0.99), id="an all-free map finds nothing"),
        pytest.param(Beside(1.0, 2.0, -0.01), id="an all-occupied map has no order"),
        pytest.param(Beside(2.0, 1.0, 0.03), id="three points more of what is there called free"),
    ],
)
def test_a_map_without_a_thought_keeps_no_bound(one: Beside) -> None:
    assert not one.kept
