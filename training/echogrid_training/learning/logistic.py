"""Logistic regression: the log-odds that sums of features are worth, by greatest likelihood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from echogrid.core.messages import Floats

RIDGE = 1e-6  # about the start: finite even where features tell the classes apart perfectly
NO_WORSE = 1e-12  # what rounding does to the mean likelihood


def fit_logistic(features: Floats, occupied: NDArray[np.bool_], start: Floats, steps: int = 50) -> Floats:
    """(F,) weights w so that w @ features are log-odds of `occupied` (N,). features: (F, N), a row of ones among them for the offset.

    `start` (F,), unchanged, where one of the two classes is missing. Newton's method; a step that leads uphill is halved until it does
    not, because from a start far away whole steps may oscillate forever.
    """
    if occupied.all() or not occupied.any():
        return start
    y = occupied.astype(float)

    def unlikelihood(weights: Floats) -> float:
        z = weights @ features
        return float((np.logaddexp(0, z) - y * z).mean() + RIDGE / 2 * ((weights - start) ** 2).sum())

    weights, least = start.copy(), unlikelihood(start)
    for _ in range(steps):
        p = 0.5 + 0.5 * np.tanh(0.5 * (weights @ features))
        slope = features @ (p - y) / len(y) + RIDGE * (weights - start)
        curve = (features * (p * (1 - p))) @ features.T / len(y) + RIDGE * np.eye(len(start))
        step = np.linalg.solve(curve, slope)
        while (there := unlikelihood(weights - step)) > least + NO_WORSE:
            step = step / 2
        weights, least = weights - step, there
        if np.abs(step).max() < 1e-9:
            break
    return weights
