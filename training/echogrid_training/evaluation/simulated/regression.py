"""Maps by regression on points of occupied and free space: a Gaussian process, and the logistic regression of Hilbert maps.

Both with a squared exponential kernel of `length` m. It is a product over x and y, and so are the cells of a grid, which makes an answer at
all of them cheap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.messages import Floats
from echogrid_training.evaluation.reading import Scores

FARTHEST = 50.0  # exponent of the kernel: beyond, numbers get too small to be worked on fast
STEPS, ENOUGH = 20, 1e-3  # of Newton's method, in log-odds


@dataclass(frozen=True)
class GaussianProcess:
    """Callable: points (N, 2) m and their values (N,) -> the posterior's mean (H, W) at the cells' centres (O'Callaghan & Ramos 2012).

    Of variance 1 and mean 0, observed with `noise` (a standard deviation).
    """

    length: float
    noise: float

    def __call__(self, points: Floats, values: Floats, spec: GridSpec) -> Scores:
        covariance = kernel(points, self.length)
        covariance[np.diag_indices_from(covariance)] += self.noise**2
        return on_cells(points, cho_solve(cho_factor(covariance), values), self.length, spec)


@dataclass(frozen=True)
class HilbertMap:
    """Callable: points (N, 2) m and their values (N,), 1 or -1 -> log-odds (H, W) (Ramos & Ott 2016).

    Logistic regression in the kernel's own space, which their random features come near to as there are more of them; `ridge` weighs the
    function's squared norm. Newton's method as in Rasmussen & Williams 2006, algorithm 3.1.
    """

    length: float
    ridge: float

    def __call__(self, points: Floats, values: Floats, spec: GridSpec) -> Scores:
        prior, occupied = kernel(points, self.length) / self.ridge, values > 0
        log_odds, weights = np.zeros(len(points)), np.zeros(len(points))
        for _ in range(STEPS):
            p = 0.5 + 0.5 * np.tanh(0.5 * log_odds)
            root = np.sqrt(p * (1 - p))
            pull = root**2 * log_odds + occupied - p
            factor = cho_factor(np.eye(len(points)) + root[:, None] * prior * root)
            weights = pull - root * cho_solve(factor, root * (prior @ pull))
            before, log_odds = log_odds, prior @ weights
            if np.abs(log_odds - before).max() < ENOUGH:
                break
        return on_cells(points, weights / self.ridge, self.length, spec)


def kernel(points: Floats, length: float) -> Floats:
    """(N, N) between points (N, 2)."""
    return _along(points[:, 0], points[:, 0], length) * _along(points[:, 1], points[:, 1], length)


def on_cells(points: Floats, weights: Floats, length: float, spec: GridSpec) -> Scores:
    """(H, W): the sum over points (N, 2) of weight (N,) times the kernel to every cell's centre."""
    axis = spec.centres()[0, :, 0]
    return np.asarray((_along(axis, points[:, 1], length) * weights) @ _along(points[:, 0], axis, length), dtype=np.float32)


def _along(one: Floats, other: Floats, length: float) -> Floats:
    """The kernel of one axis, (N, M) of coordinates (N,) and (M,)."""
    factor: Floats = np.exp(-np.minimum((one[:, None] - other[None, :]) ** 2 / (2 * length**2), FARTHEST))
    return factor
