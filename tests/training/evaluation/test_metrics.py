"""Figures of merit against slow and obvious references."""

from __future__ import annotations

import math

import numpy as np
import pytest

from echogrid_training.evaluation.metrics import (
    average_precision,
    best_bin,
    best_threshold,
    calibration_error,
    distances,
    f_score,
    iou,
    nearness,
    overlap,
    overlaps,
    precision_area,
    reliability,
    surprise,
)


def scored(seed: int, count: int = 300, levels: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Scores with many ties, and truth that they know a little about."""
    rng = np.random.default_rng(seed)
    occupied = rng.uniform(size=count) < 0.2
    return np.round(levels * (rng.normal(size=count) + occupied)) / levels, occupied


@pytest.mark.parametrize("seed", range(4))
def test_average_precision_is_a_sweep_over_all_thresholds(seed: int) -> None:
    scores, occupied = scored(seed)
    area, recall = 0.0, 0.0
    for threshold in sorted(set(scores.tolist()), reverse=True):
        called = scores >= threshold
        right = (called & occupied).sum()
        area += right / called.sum() * (right / occupied.sum() - recall)
        recall = right / occupied.sum()
    assert average_precision(scores, occupied) == pytest.approx(area)


def test_average_precision_of_what_knows_all_and_nothing() -> None:
    occupied = np.array([True, False, False, True, False])
    assert average_precision(occupied.astype(float), occupied) == 1.0
    assert average_precision(np.zeros(5), occupied) == pytest.approx(0.4)  # the share of occupied
    assert average_precision(-occupied.astype(float), occupied) == pytest.approx(0.4)
    assert math.isnan(average_precision(np.arange(3.0), np.zeros(3, dtype=bool)))


def test_precision_area_takes_many_histograms_at_once_and_empty_bins_do_not_count() -> None:
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 5, (3, 2, 6))
    each = [
        average_precision(np.repeat(np.tile(np.arange(6), 2), one.reshape(-1)), np.repeat([0, 1], one.sum(axis=1)) > 0) for one in counts
    ]
    np.testing.assert_allclose(precision_area(counts), each)
    spaced = np.zeros((3, 2, 12), dtype=int)
    spaced[:, :, 1::2] = counts
    np.testing.assert_allclose(precision_area(spaced), each)


@pytest.mark.parametrize("seed", range(4))
def test_the_best_threshold_is_the_best_of_all(seed: int) -> None:
    scores, occupied = scored(seed)
    best = max(iou(overlap(scores >= threshold, occupied)) for threshold in set(scores.tolist()))
    assert iou(overlap(scores >= best_threshold(scores, occupied), occupied)) == best


def test_cells_counted_by_score_overlap_as_cells_do() -> None:
    scores, occupied = scored(1)
    levels = np.unique(scores)
    histogram = np.stack([[np.sum(scores[occupied == kind] == level) for level in levels] for kind in (False, True)])
    for level, counts in zip(levels, overlaps(histogram).T, strict=True):
        np.testing.assert_array_equal(counts, overlap(scores >= level, occupied))
    assert levels[best_bin(histogram)] == best_threshold(scores, occupied)


def test_a_line_beside_a_line() -> None:
    """A wall drawn one cell beside the true one has no cell right, but all within one cell; two cells beside, all within two."""
    truth = np.zeros((20, 20), dtype=bool)
    truth[10, 3:17] = True
    for shift, f1, f2 in ((0, 1.0, 1.0), (1, 1.0, 1.0), (2, 0.0, 1.0), (3, 0.0, 0.0)):
        drawn = np.roll(truth, shift, axis=0)
        assert f_score(nearness(drawn, truth, 1.0)) == f1
        assert f_score(nearness(drawn, truth, 2.0)) == f2
        assert iou(overlap(drawn, truth)) == float(shift == 0)


def test_nearness_is_the_distance_of_all_pairs() -> None:
    rng = np.random.default_rng(1)
    drawn, truth = rng.uniform(size=(2, 15, 15)) < 0.04
    apart = np.hypot(*(np.argwhere(drawn)[:, None] - np.argwhere(truth)[None]).transpose(2, 0, 1))
    for reach in (1.0, 2.0, 3.0):
        near, all_drawn, found, all_true = nearness(drawn, truth, reach, distances(truth))
        assert (near, found) == ((apart <= reach).any(axis=1).sum(), (apart <= reach).any(axis=0).sum())
        assert (all_drawn, all_true) == apart.shape


def test_nothing_drawn_or_nothing_there() -> None:
    none, one = np.zeros((4, 4), dtype=bool), np.eye(4, dtype=bool)
    assert f_score(nearness(none, one, 1.0)) == 0.0
    assert f_score(nearness(one, none, 1.0)) == 0.0
    assert math.isnan(f_score(nearness(none, none, 1.0)))
    assert math.isnan(iou(overlap(none, none)))


def test_calibration_error_of_constructed_probabilities() -> None:
    """Ten cells are said to be occupied with 0.3, of which five are: 0.2 off; thirty with 0.9, of which 27 are: right."""
    p = np.repeat((0.3, 0.9), (10, 30))
    occupied = np.concatenate((np.arange(10) < 5, np.arange(30) < 27))
    table = reliability(p, occupied)
    assert table[0].sum() == 40
    assert calibration_error(table) == pytest.approx(0.25 * 0.2)
    assert calibration_error(reliability(np.array([0.0, 1.0]), np.array([False, True]))) == 0.0  # both ends have a bin


def test_surprise_is_the_logarithm_of_what_was_said() -> None:
    p = np.array([0.1, 0.5, 0.99])
    log_odds = np.log(p / (1 - p))
    np.testing.assert_allclose(surprise(log_odds, np.array([True, True, True])), -np.log(p))
    np.testing.assert_allclose(surprise(log_odds, np.array([False, False, False])), -np.log(1 - p))
    assert surprise(np.array([-900.0]), np.array([True]))[0] == 900.0
