"""Maps by regression on observations of occupied and free cells: a Gaussian process, and the logistic regression of Hilbert maps.

Both with a squared exponential kernel of `length` m. Observations lie at cells' centres, and the kernel is a product over x and y: times a
vector it is two products with a kernel along one axis, whatever the number of observations. So all of a patch's are used, and the equations
are solved by conjugate gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.messages import Floats
from echogrid_training.evaluation.reading import Scores

FARTHEST = 50.0  # exponent of the kernel: beyond, numbers get too small to be worked on fast
STEPS, ENOUGH = 20, 1e-3  # of Newton's method, in log-odds
SOLVED, MOST = 1e-6, 1000  # residual of conjugate gradients as a share of what was asked, and their steps

Cells = NDArray[np.intp]


@dataclass(frozen=True)
class GaussianProcess:
    """Callable: flat cells (N,) and their values (N,) -> the posterior's mean (H, W) at the cells' centres (O'Callaghan & Ramos 2012).

    Of variance 1 and mean 0, observed with `noise` (a standard deviation).
    """

    length: float
    noise: float

    def __call__(self, cells: Cells, values: Floats, spec: GridSpec) -> Scores:
        kernel = Kernel(cells, self.length, spec)
        weights = solved(lambda v: kernel(v) + self.noise**2 * v, values)
        return kernel.on_cells(weights)


@dataclass(frozen=True)
class HilbertMap:
    """Callable: flat cells (N,) and their values (N,), 1 or -1 -> log-odds (H, W) (Ramos & Ott 2016).

    Logistic regression in the kernel's own space, which their random features come near to as there are more of them; `ridge` weighs the
    function's squared norm. Newton's method as in Rasmussen & Williams 2006, algorithm 3.1.
    """

    length: float
    ridge: float

    def __call__(self, cells: Cells, values: Floats, spec: GridSpec) -> Scores:
        kernel, occupied = Kernel(cells, self.length, spec), values > 0
        log_odds, weights, inner = np.zeros(len(cells)), np.zeros(len(cells)), np.zeros(len(cells))
        for _ in range(STEPS):
            p = 0.5 + 0.5 * np.tanh(0.5 * log_odds)
            root = np.sqrt(p * (1 - p))
            pull = root**2 * log_odds + occupied - p

            def system(v: Floats, root: Floats = root) -> Floats:
                return v + root * kernel(root * v) / self.ridge

            inner = solved(system, root * kernel(pull) / self.ridge, inner)
            weights = pull - root * inner
            before, log_odds = log_odds, kernel(weights) / self.ridge
            if np.abs(log_odds - before).max() < ENOUGH:
                break
        return kernel.on_cells(weights / self.ridge)


class Kernel:
    """Callable: (N,) -> (N,), the kernel between observations at flat cells (N,), a cell as often as it was observed, times a vector."""

    def __init__(self, cells: Cells, length: float, spec: GridSpec) -> None:
        axis = (np.arange(spec.cells) * spec.cell)[:, None]
        self._along: Floats = np.exp(-np.minimum((axis - axis.T) ** 2 / (2 * length**2), FARTHEST))  # (cells, cells)
        self._cells, self._side = cells, spec.cells

    def __call__(self, vector: Floats) -> Floats:
        return self._spread(vector).reshape(-1)[self._cells]

    def on_cells(self, weights: Floats) -> Scores:
        """(H, W): the sum over observations of weight (N,) times the kernel to every cell's centre."""
        return self._spread(weights).astype(np.float32)

    def _spread(self, vector: Floats) -> Floats:
        heaped = np.bincount(self._cells, weights=vector, minlength=self._side**2).reshape(self._side, self._side)
        return self._along @ heaped @ self._along


def solved(matrix: Callable[[Floats], Floats], right: Floats, start: Floats | None = None) -> Floats:
    """x (N,) with matrix x = right (N,), of a symmetric positive matrix that is told by what it makes of a vector."""
    x = np.zeros_like(right) if start is None else start
    left = right - matrix(x)
    way, square = left, float(left @ left)
    goal = SOLVED**2 * float(right @ right)
    for _ in range(MOST):
        if square <= goal:
            break
        turned = matrix(way)
        step = square / float(way @ turned)
        x, left = x + step * way, left - step * turned
        before, square = square, float(left @ left)
        way = left + (square / before) * way
    return x
