"""Figures of what a map said to rays that it was not shown, with intervals over stretches of way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map.tiled_map import probability
from echogrid.core.messages import Floats
from echogrid_training.evaluation.recorded.scores import FREE, OCCUPIED
from echogrid_training.own.half import EVERY, Answers

DRAWN, INTERVAL = 500, (2.5, 97.5)
BINS = 10
RANGES = ((0.0, 5.0), (5.0, 10.0), (10.0, 15.0), (15.0, 21.0))  # m
AGES = ((0.0, 1.5), (1.5, 10.0), (10.0, 60.0), (60.0, 1e9), (1e9, np.inf))  # s; the last: never in view
AGE_NAMES = ("in view just before", "2 to 10 s ago", "10 to 60 s ago", "longer ago", "never in view before")
LEAST = 20  # answers of a bin whose share is shown


@dataclass(frozen=True, slots=True)
class Share:
    """A share and the middle 95 % of draws of stretches; NaN of nothing."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Live:
    """Of detections that the map was not shown, when they came."""

    detections: int
    found: Share  # within a cell of an occupied one
    called_free: Share  # in a cell called free
    unknown: Share  # in a cell of which the map said nothing


def live(asked: Answers) -> Live:
    """By the published thresholds."""
    hits = asked.where(asked.hit)
    known = hits.log_odds != 0
    found, free = hits.reach > OCCUPIED, known & (hits.log_odds < FREE)
    return Live(len(hits), *(share(one, hits.stretch) for one in (found, free, ~known)))


def share(true: NDArray[np.bool_], stretch: NDArray[np.int64]) -> Share:
    """Of what is true of (N,), drawn by stretch."""
    if not len(true):
        return Share(*3 * (float("nan"),))
    _, place = np.unique(stretch, return_inverse=True)
    counts = np.stack((np.bincount(place, weights=true), np.bincount(place)))
    yes, all_ = counts[:, drawn(counts.shape[1])].sum(axis=-1)
    low, high = np.percentile(yes / all_, INTERVAL)
    return Share(float(true.mean()), float(low), float(high))


def drawn(stretches: int) -> NDArray[np.int64]:
    """(DRAWN, S): numbers of as many stretches as there are, with repeats; always the same."""
    return np.random.default_rng(0).integers(0, stretches, (DRAWN, stretches))


def diagram(asked: Answers) -> Floats:
    """(3, BINS): by stated p, rays that passed or ended there, the sum of p, and how many ended. What is not known is left out.

    A thing returns nothing to most looks, so what ended is less than what is occupied; but the more was said, the more has to end.
    """
    known = asked.where(asked.log_odds != 0)
    return binned(probability(known.log_odds.astype(np.float32)).astype(float), known.hit, np.where(known.hit, 1.0, float(EVERY)))


def binned(p: Floats, true: NDArray[np.bool_], weight: Floats | None = None) -> Floats:
    """(3, BINS) of p (N,): counts, sums of p, and counts of what is true, all weighted."""
    weight = np.ones(len(p)) if weight is None else weight
    which = np.clip((p * BINS).astype(np.intp), 0, BINS - 1)
    return np.stack([np.bincount(which, weights=one, minlength=BINS) for one in (weight, weight * p, weight * true)])


def points(table: Floats) -> tuple[Floats, Floats]:
    """What was stated and what was so, of the bins that hold LEAST."""
    enough = table[0] >= LEAST
    return table[1][enough] / table[0][enough], table[2][enough] / table[0][enough]


def by_radar(asked: Answers, names: tuple[str, ...]) -> dict[str, Answers]:
    return {name: asked.where(asked.radar == number) for number, name in enumerate(names)}


def by_range(asked: Answers) -> dict[str, Answers]:
    return {f"{low:g} to {high:g} m": asked.where((asked.range >= low) & (asked.range < high)) for low, high in RANGES}


def by_age(asked: Answers) -> dict[str, Answers]:
    """Never in view before: inf."""
    parts = {
        name: asked.where((asked.age >= low) & ((asked.age < high) | (np.isinf(asked.age) & np.isinf(high))))
        for name, (low, high) in zip(AGE_NAMES, AGES, strict=True)
    }
    return {name: part for name, part in parts.items() if len(part)}
