"""Sums that add up: of parts as of the whole, and the figures made of them against pooled arrays."""

from __future__ import annotations

import numpy as np
import pytest

from echogrid_training.evaluation.metrics import average_precision, iou, overlap, surprise
from echogrid_training.evaluation.reading import Reading
from echogrid_training.evaluation.simulated.tally import (
    Place,
    Tally,
    by_stratum,
    class_errors,
    figures,
    resampled,
    summed,
    tally,
)
from echogrid_training.resampling import interval, resamples
from echogrid_training.truth.ground_truth import soft, ternary

SIDE = 24
READ = Reading(slope=1.5, offset=-0.5, silent=-2.0, threshold=0.3)


def window(seed: int) -> tuple[np.ndarray, np.ndarray, Place]:
    """Scores, labels, and a truth with unknown cells and a car in the middle; two strata."""
    rng = np.random.default_rng(seed)
    truth = (rng.normal(size=(SIDE, SIDE)) * (rng.uniform(size=(SIDE, SIDE)) < 0.7)).astype(np.float32)
    scores = (truth + rng.normal(size=(SIDE, SIDE)) * (1 + seed % 3)).astype(np.float32)
    scores[rng.uniform(size=scores.shape) < 0.1] = 0.0
    outside = np.ones((SIDE, SIDE), dtype=bool)
    outside[10:14, 8:16] = False
    left = np.arange(SIDE)[:, None] * np.ones(SIDE) < 9
    return scores, np.tanh(scores / 2), Place(truth, outside, np.stack((left, ~left)))


@pytest.fixture(scope="module")
def windows() -> list[tuple[np.ndarray, np.ndarray, Place]]:
    return [window(seed) for seed in range(6)]


@pytest.fixture(scope="module")
def tallies(windows: list[tuple[np.ndarray, np.ndarray, Place]]) -> list[Tally]:
    return [tally(scores, label, place, READ) for scores, label, place in windows]


def pooled(windows: list[tuple[np.ndarray, np.ndarray, Place]]) -> tuple[np.ndarray, np.ndarray]:
    log_odds = np.concatenate([READ(scores)[place.counted] for scores, _, place in windows])
    return log_odds, np.concatenate([place.truth[place.counted] > 0 for _, _, place in windows])


def test_figures_are_those_of_all_cells_together(windows: list[tuple[np.ndarray, np.ndarray, Place]], tallies: list[Tally]) -> None:
    log_odds, occupied = pooled(windows)
    p = 1 / (1 + np.exp(-log_odds))
    found = figures(summed(tallies))
    assert found["ap"] == pytest.approx(average_precision(log_odds, occupied), abs=2e-3)  # its log-odds are rounded to 1 / 64
    assert found["iou"] == iou(overlap(log_odds >= READ.threshold, occupied))
    assert found["nll"] == pytest.approx(surprise(log_odds, occupied).mean())
    assert found["brier"] == pytest.approx(((p - occupied) ** 2).mean())
    assert found["unsafe"] == pytest.approx(occupied[p < 0.1].mean())
    assert found["said"] == pytest.approx(0.9, abs=0.05)


def test_what_is_published_is_judged_where_something_is(windows: list[tuple[np.ndarray, np.ndarray, Place]], tallies: list[Tally]) -> None:
    raw = np.concatenate([scores[place.counted] for scores, _, place in windows])
    _, occupied = pooled(windows)
    found = figures(summed(tallies))
    assert found["published_nll"] == pytest.approx(surprise(raw[raw != 0], occupied[raw != 0]).mean())
    sure = np.abs(raw) >= 3.5
    assert 0 < sure.sum() < len(raw)
    assert found["sure"] == pytest.approx(sure.sum() / (raw != 0).sum())
    assert found["sure_and_wrong"] == pytest.approx(((raw > 0) != occupied)[sure].mean())


def test_class_errors_cell_by_cell(windows: list[tuple[np.ndarray, np.ndarray, Place]]) -> None:
    """Over all cells but those under the car, also where truth was never observed."""
    _, label, place = windows[0]
    sums = np.zeros((2, 2, 3))
    for row, column in np.argwhere(place.outside):
        for kind, true in enumerate((ternary(place.truth)[row, column], soft(place.truth)[row, column])):
            member = int(ternary(place.truth)[row, column]) + 1
            sums[kind, :, member] += (label[row, column] - true) ** 2, 1
    np.testing.assert_allclose(class_errors(label, place), sums, rtol=1e-5)


def test_who_says_nothing_errs_by_one_and_who_has_no_label_is_not_judged_by_it(windows: list[tuple[np.ndarray, np.ndarray, Place]]) -> None:
    scores, _, place = windows[0]
    found = figures(tally(scores, np.zeros_like(scores), place, READ))
    assert [found[f"mse_{name}"] for name in ("free", "unknown", "occupied")] == [1.0, 0.0, 1.0]
    assert np.isnan(figures(tally(scores, None, place, READ))["mse_free"])


def test_strata_are_judged_as_if_they_were_all(windows: list[tuple[np.ndarray, np.ndarray, Place]], tallies: list[Tally]) -> None:
    parts = by_stratum(summed(tallies), ("left", "right"))
    for index, name in enumerate(("left", "right")):
        alone = [tally(scores, None, Place.plain(place.truth, place.outside & place.strata[index]), READ) for scores, _, place in windows]
        expected = figures(summed(alone))
        assert parts[name]["ap"] == expected["ap"]
        assert parts[name]["nll"] == pytest.approx(expected["nll"])
    assert parts["left"]["cells"] + parts["right"]["cells"] == pytest.approx(1.0)


def test_towns_drawn_once_each_are_all_towns(tallies: list[Tally]) -> None:
    once = resampled(tallies, np.ones((1, len(tallies)), dtype=int))
    found = figures(summed(tallies))
    assert {"ap", "iou", "nll"} <= once.keys() <= found.keys()
    for name, values in once.items():
        assert values[0] == pytest.approx(found[name]), name


def test_towns_drawn_twice_count_twice(tallies: list[Tally]) -> None:
    draws = np.array([[2, 0, 1, 0, 0, 3]])
    found = figures(summed([tallies[0], tallies[0], tallies[2], *[tallies[5]] * 3]))
    for name, values in resampled(tallies, draws).items():
        assert values[0] == pytest.approx(found[name]), name


def test_intervals(tallies: list[Tally]) -> None:
    """They hold the figure of all towns, and one town alone leaves no doubt."""
    draws = resamples(len(tallies))
    assert (draws.sum(axis=1) == len(tallies)).all()
    low, high = interval(resampled(tallies, draws)["ap"])
    assert low < figures(summed(tallies))["ap"] < high
    low, high = interval(resampled(tallies[:1], resamples(1))["ap"])
    assert low == high == pytest.approx(figures(tallies[0])["ap"])
