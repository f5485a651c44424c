"""Figures of merit for maps of occupied and free, each a pure function of numbers that add up over cells, patches and towns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from echogrid.core.messages import Floats

Mask = NDArray[np.bool_]
Counts = NDArray[np.int64]
ECE_BINS = 20  # of equal width


def average_precision(scores: NDArray[np.floating], occupied: Mask) -> float:
    """Area under precision over recall: the mean, over the occupied ones, of the precision at the threshold that just finds them.

    scores and occupied: (N,); a higher score is meant as more likely occupied. Equal scores fall together. NaN where nothing is occupied.
    """
    _, place = np.unique(scores, return_inverse=True)
    return float(precision_area(np.stack([np.bincount(place[occupied == kind], minlength=len(_)) for kind in (False, True)])))


def precision_area(histogram: Counts | Floats) -> Floats:
    """Average precision (…,) of cells counted by score: (…, 2, B), free and occupied, bins of rising score. NaN where none is occupied."""
    false, true = (np.cumsum(histogram[..., kind, ::-1], axis=-1) for kind in (0, 1))
    precision = true / np.maximum(true + false, 1)
    found = histogram[..., 1, ::-1]
    with np.errstate(invalid="ignore"):
        area: Floats = (precision * found).sum(axis=-1) / found.sum(axis=-1)
    return area


def best_threshold(scores: NDArray[np.floating], occupied: Mask) -> float:
    """The threshold at which `scores >= threshold` overlaps best (IoU) with occupied, both (N,); the highest of equally good ones."""
    values, place = np.unique(scores, return_inverse=True)
    return float(values[best_bin(np.stack([np.bincount(place[occupied == kind], minlength=len(values)) for kind in (False, True)]))])


def best_bin(histogram: Counts) -> int:
    """The bin from which on cells overlap best with the occupied, of (2, B) free and occupied by score; the last of equally good ones."""
    counts = overlaps(histogram)
    over_union = counts[0] / np.maximum(counts.sum(axis=0), 1)
    return int(len(over_union) - 1 - np.argmax(over_union[::-1]))


def overlaps(histogram: Counts) -> Counts:
    """(3, B): what `overlap` counts where cells, counted by score (2, B), are called occupied from each bin on."""
    wrongly, rightly = np.cumsum(histogram[:, ::-1], axis=1)[:, ::-1]
    return np.stack((rightly, wrongly, histogram[1].sum() - rightly))


def overlap(decided: Mask, occupied: Mask) -> Counts:
    """(3,): cells rightly called occupied, wrongly, and missed."""
    return np.array([np.sum(decided & occupied), np.sum(decided & ~occupied), np.sum(~decided & occupied)])


def iou(counts: Counts) -> float:
    """Intersection over union of `overlap`'s counts; NaN where nothing is occupied nor called so."""
    return ratio(counts[0], counts.sum())


def distances(occupied: Mask) -> Floats:
    """(H, W) cells to the nearest occupied one, 0 on it; infinite where there is none."""
    if not occupied.any():
        return np.full(occupied.shape, np.inf)
    far: Floats = distance_transform_edt(~occupied)
    return far


def nearness(decided: Mask, occupied: Mask, reach: float, to_occupied: Floats | None = None) -> Counts:
    """(4,): cells called occupied that have a truly occupied one within `reach` cells, all called so; and the other way round.

    `to_occupied`: `distances(occupied)`, where it is at hand. Within: centre to centre, so that 1 is the four neighbours.
    """
    far = distances(occupied) if to_occupied is None else to_occupied
    return np.array([np.sum(far[decided] <= reach), np.sum(decided), np.sum(distances(decided)[occupied] <= reach), np.sum(occupied)])


def f_score(counts: Counts) -> float:
    """Harmonic mean of precision and recall of `nearness`'s counts; NaN where nothing is occupied nor called so."""
    if not counts[1] or not counts[3]:
        return 0.0 if counts[1] or counts[3] else float("nan")
    precision, recall = ratio(counts[0], counts[1]), ratio(counts[2], counts[3])
    return 0.0 if precision + recall == 0 else 2 * precision * recall / (precision + recall)


def surprise(log_odds: NDArray[np.floating], occupied: Mask) -> Floats:
    """(N,) nats: -ln of the probability that was given to what is true."""
    lost: Floats = np.logaddexp(0.0, np.where(occupied, -log_odds, log_odds))
    return lost


def reliability(p: NDArray[np.floating], occupied: Mask, bins: int = ECE_BINS) -> Floats:
    """(3, bins): by stated probability of occupied, the cells, the sum of what was stated, and how many are occupied."""
    which = np.clip((p * bins).astype(np.intp), 0, bins - 1)
    return np.stack([np.bincount(which, weights=weight, minlength=bins) for weight in (np.ones_like(p), p, occupied.astype(float))])


def calibration_error(table: Floats) -> float:
    """Expected calibration error of `reliability`'s table: mean distance of stated probability and occupied share, by cells."""
    return ratio(np.abs(table[1] - table[2]).sum(), table[0].sum())


def ratio(part: float, whole: float) -> float:
    """NaN of nothing."""
    return float(part) / float(whole) if whole else float("nan")
