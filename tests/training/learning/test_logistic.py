"""Logistic regression against the same likelihood handed to another optimiser."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from echogrid_training.learning.logistic import RIDGE, fit_logistic


def data(seed: int, count: int = 2000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three features, a row of ones among them, labels drawn by the weights that come last."""
    rng = np.random.default_rng(seed)
    weights = rng.normal(0, 1, 3) * (1.5, 0.3, 2.0)
    features = np.stack((rng.normal(0, 2, count), rng.exponential(1.0, count), np.ones(count)))
    return features, rng.uniform(size=count) < 1 / (1 + np.exp(-weights @ features)), weights


@pytest.mark.parametrize("seed", range(8))
def test_the_weights_are_those_of_the_greatest_likelihood(seed: int) -> None:
    """From a start as far off as a weak network's: with seed 0 Newton's whole steps would go to and fro between two places."""
    features, occupied, _ = data(seed)
    start = np.array([1.0, 0.0, 0.0])

    def unlikely(weights: np.ndarray) -> float:
        """Minus the mean log-likelihood, term by term, and the pull towards the start."""
        z = weights @ features
        return float(np.logaddexp(0, np.where(occupied, -z, z)).mean() + RIDGE / 2 * ((weights - start) ** 2).sum())

    found = fit_logistic(features, occupied, start)
    best = minimize(unlikely, start, method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-14, "maxiter": 4000, "maxfev": 4000})
    np.testing.assert_allclose(found, best.x, atol=1e-4)
    assert unlikely(found) <= best.fun + 1e-12
    assert start.tolist() == [1.0, 0.0, 0.0]


def test_the_weights_that_drew_the_labels_come_back() -> None:
    features, occupied, weights = data(7, 200_000)
    np.testing.assert_allclose(fit_logistic(features, occupied, np.zeros(3)), weights, atol=0.05)


def test_at_the_optimum_what_is_said_agrees_with_what_was_seen() -> None:
    """The offset's equation: the mean probability is the share of occupied; a feature's: no residual goes along with it."""
    features, occupied, _ = data(3)
    p = 1 / (1 + np.exp(-fit_logistic(features, occupied, np.zeros(3)) @ features))
    np.testing.assert_allclose(features @ (p - occupied) / len(p), 0.0, atol=1e-5)


def test_where_features_tell_the_classes_apart_it_stays_finite_and_where_one_is_missing_it_stays_put() -> None:
    x = np.linspace(-1, 1, 50)
    apart = fit_logistic(np.stack((x, np.ones(50))), x > 0, np.array([1.0, 0.0]))
    assert np.isfinite(apart).all()
    assert ((apart @ np.stack((x, np.ones(50))) > 0) == (x > 0)).all()
    for missing in (np.zeros(50, dtype=bool), np.ones(50, dtype=bool)):
        assert fit_logistic(np.stack((x, np.ones(50))), missing, np.array([0.3, 0.4])).tolist() == [0.3, 0.4]
