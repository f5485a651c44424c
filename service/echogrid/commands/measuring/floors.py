"""What this machine does at best: multiply-adds and copies, beside which the rest is judged."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

TURNS = 15
SIDE, MIB = 192, 16


def floors() -> dict[str, float]:
    """The best of some: multiply-adds of float32, millions a second of processor time, in a product of matrices; MiB copied a second."""
    random = np.random.default_rng(0)
    one, other = random.normal(size=(2, SIDE, SIDE)).astype(np.float32)
    product = np.empty_like(one)
    source, copy = np.ones((2, MIB << 18), np.float32)
    return {
        "multiply_adds_millions_per_s": SIDE**3 / 1e6 / best(lambda: np.matmul(one, other, out=product)),
        "copied_mib_per_s": MIB / best(lambda: np.copyto(copy, source)),
    }


def best(work: Callable[[], object], turns: int = TURNS) -> float:
    """Least s of processor time, of all threads, of several calls."""
    least = float("inf")
    for _ in range(turns):
        begun = time.process_time()
        work()
        least = min(least, time.process_time() - begun)
    return max(least, 1e-7)
