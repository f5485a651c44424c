"""Reading scores as log-odds: two numbers, what silence is worth, and a threshold."""

from __future__ import annotations

import numpy as np
import pytest

from echogrid_training.evaluation.metrics import average_precision, iou, overlap
from echogrid_training.evaluation.reading import fit_reading, unlikelihood


def spoken(slope: float, offset: float, count: int = 40_000) -> tuple[np.ndarray, np.ndarray]:
    """Scores whose log-odds are slope * score + offset, in truth."""
    rng = np.random.default_rng(0)
    scores = rng.normal(size=count).astype(np.float32)
    return scores, rng.uniform(size=count) < 1 / (1 + np.exp(-(slope * scores + offset)))


def test_the_true_log_odds_are_found() -> None:
    read = fit_reading(*spoken(2.0, -3.0))
    assert read.slope == pytest.approx(2.0, abs=0.1)
    assert read.offset == pytest.approx(-3.0, abs=0.1)


def test_the_order_stays() -> None:
    scores, occupied = spoken(2.0, -3.0)
    read = fit_reading(scores, occupied)
    assert (np.argsort(read(scores), kind="stable") == np.argsort(scores, kind="stable")).all()
    assert average_precision(read(scores), occupied) == average_precision(scores, occupied)


def test_another_scale_and_origin_of_the_scores_read_the_same() -> None:
    scores, occupied = spoken(1.0, -2.0)
    one, other = fit_reading(scores, occupied), fit_reading((scores * 20 + 300).astype(np.float32), occupied)
    np.testing.assert_allclose(one(scores), other((scores * 20 + 300).astype(np.float32)), atol=1e-2)
    assert unlikelihood(scores, occupied) == pytest.approx(unlikelihood(scores * 20 + 300, occupied), abs=1e-4)


def test_silence_is_worth_the_share_of_occupied_cells_in_it() -> None:
    scores, occupied = spoken(2.0, -1.0)
    silent = np.concatenate((np.zeros(1000), scores)).astype(np.float32)
    truth = np.concatenate((np.arange(1000) < 100, occupied))
    read, alone = fit_reading(silent, truth), fit_reading(scores, occupied)
    assert read.silent == pytest.approx(np.log(100 / 900), abs=0.01)
    assert (read.slope, read.offset) == (pytest.approx(alone.slope), pytest.approx(alone.offset))


def test_who_never_says_anything_says_the_prior() -> None:
    read = fit_reading(np.zeros(1000, dtype=np.float32), np.arange(1000) < 50)
    p = 1 / (1 + np.exp(-read(np.zeros(1))[0]))
    assert p == pytest.approx(0.05, abs=1e-3)


def test_who_always_says_something_has_the_prior_for_silence() -> None:
    scores, occupied = spoken(2.0, -3.0)
    read = fit_reading(scores, occupied)
    assert read.silent == pytest.approx(np.log(occupied.mean() / (1 - occupied.mean())), abs=1e-3)


def test_the_threshold_overlaps_best() -> None:
    scores, occupied = spoken(3.0, -2.0, 2000)
    read = fit_reading(scores, occupied)
    best = max(iou(overlap(scores >= threshold, occupied)) for threshold in scores[:200].tolist())
    assert iou(overlap(read(scores) >= read.threshold, occupied)) >= best
