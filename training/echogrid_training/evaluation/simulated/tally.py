"""What adds up over cells, patches, drives and towns, and the figures that are made of such sums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import Image
from echogrid.core.map.tiled_map import probability
from echogrid.core.messages import Floats
from echogrid_training.evaluation.metrics import (
    Counts,
    Mask,
    calibration_error,
    distances,
    f_score,
    iou,
    nearness,
    overlap,
    precision_area,
    ratio,
    reliability,
    surprise,
)
from echogrid_training.evaluation.reading import Reading, Scores
from echogrid_training.truth.ground_truth import soft, ternary

BINS, WIDEST = 2048, 16.0  # of log-odds, from -WIDEST to WIDEST: 1/64 wide
REACHES = (1.0, 2.0)  # cells, of the boundary's F
SURE = 3.5  # log-odds: the service's clamp of sums
SAFE = 0.1  # what is stated below is taken for free
CLASSES = (-1, 0, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """One window of truth, and the cells that count."""

    truth: Image  # (H, W) log-odds; 0: never observed
    outside: Mask  # (H, W): not under the car
    strata: NDArray[np.bool_]  # (S, H, W), beside all of them together

    @staticmethod
    def plain(truth: Image, outside: Mask) -> Place:
        """Without strata."""
        return Place(truth, outside, np.zeros((0, *truth.shape), dtype=bool))

    @property
    def counted(self) -> Mask:
        """(H, W): observed, and not under the car."""
        mask: Mask = (self.truth != 0) & self.outside
        return mask


@dataclass(frozen=True, slots=True, eq=False)
class Tally:
    """Sums over the cells that count; `errors` alone also over those that truth never observed."""

    histogram: Counts  # (1 + S, 2, BINS): by stratum (the first is all), free or occupied, and log-odds
    surprise: Floats  # (1 + S,) of -ln of what was said about the truth
    brier: Floats  # () of squared errors of probability
    reliability: Floats  # (3, ECE_BINS), as metrics.reliability
    overlap: Counts  # (3,), as metrics.overlap
    near: Counts  # (2, 4), as metrics.nearness, by reach
    errors: Floats  # (2, 2, 3): ternary and soft labels, squared errors and cells, free, unknown and occupied
    safe: Counts  # (2,): cells said to be occupied with less than SAFE, and how many of them are
    said: Counts  # (2,): cells about which the method says something, all cells
    published: Floats  # (3, ECE_BINS): reliability of scores as they are, where something is said
    published_surprise: Floats  # ()
    sure: Counts  # (2,): cells with scores of SURE or more by amount, as they are, and those of them whose truth is the other


def tally(scores: Scores, label: Image | None, place: Place, reading: Reading, to_occupied: Floats | None = None) -> Tally:
    """Of one window's scores (H, W); `label` (H, W) in [-1, 1] where the method has one; `to_occupied`: metrics.distances of the truth."""
    log_odds, counted = reading(scores), place.counted
    occupied = place.truth > 0
    decided = (log_odds >= reading.threshold) & counted
    z, y = log_odds[counted], occupied[counted]
    p = probability(z.astype(np.float64))
    lost = surprise(z, y)
    strata = np.concatenate((np.ones((1, len(z)), dtype=bool), place.strata[:, counted]))
    which = np.clip(((z + WIDEST) * (BINS / (2 * WIDEST))).astype(np.intp), 0, BINS - 1) + BINS * y
    far = distances(occupied) if to_occupied is None else to_occupied
    raw, said = scores[counted].astype(float), scores[counted] != 0
    return Tally(
        histogram=np.stack([np.bincount(which[stratum], minlength=2 * BINS).reshape(2, BINS) for stratum in strata]),
        surprise=np.array([lost[stratum].sum() for stratum in strata]),
        brier=np.array(((p - y) ** 2).sum()),
        reliability=reliability(p, y),
        overlap=overlap(decided[counted], y),
        near=np.stack([nearness(decided, occupied & place.outside, reach, far) for reach in REACHES]),
        errors=np.zeros((2, 2, 3)) if label is None else class_errors(label, place),
        safe=np.array([np.sum(p < SAFE), np.sum(y[p < SAFE])]),
        said=np.array([said.sum(), len(said)]),
        published=reliability(probability(raw[said]), y[said]),
        published_surprise=np.array(surprise(raw[said], y[said]).sum()),
        sure=np.array([np.sum(np.abs(raw) >= SURE), np.sum(((raw > 0) != y)[np.abs(raw) >= SURE])]),
    )


def class_errors(label: Image, place: Place) -> Floats:
    """(2, 2, 3): against ternary and soft truth, the sum of squared errors and the cells, by class."""
    kind = ternary(place.truth)
    out = np.zeros((2, 2, 3))
    for index, true in enumerate((kind.astype(float), soft(place.truth).astype(float))):
        for column, value in enumerate(CLASSES):
            member = (kind == value) & place.outside
            out[index, :, column] = ((label[member] - true[member]) ** 2).sum(), member.sum()
    return out


def summed(tallies: Sequence[Tally]) -> Tally:
    """Of at least one."""
    return Tally(*(sum(getattr(one, field.name) for one in tallies) for field in fields(Tally)))


def figures(of: Tally) -> dict[str, float]:
    """All there is, by name; NaN where a figure has no meaning."""
    cells = float(of.said[1])
    out = {
        "ap": float(precision_area(of.histogram[0])),
        "iou": iou(of.overlap),
        "f1": f_score(of.near[0]),
        "f2": f_score(of.near[1]),
        "nll": ratio(float(of.surprise[0]), cells),
        "brier": ratio(float(of.brier), cells),
        "ece": calibration_error(of.reliability),
        "unsafe": ratio(float(of.safe[1]), float(of.safe[0])),
        "said": ratio(float(of.said[0]), cells),
        "published_nll": ratio(float(of.published_surprise), float(of.said[0])),
        "published_ece": calibration_error(of.published),
        "sure": ratio(float(of.sure[0]), float(of.said[0])),
        "sure_and_wrong": ratio(float(of.sure[1]), float(of.sure[0])),
    }
    for kind, sums in zip(("mse", "soft_mse"), of.errors, strict=True):
        for name, error, count in zip(("free", "unknown", "occupied"), *sums.tolist(), strict=True):
            out[f"{kind}_{name}"] = ratio(error, count)
    return out


def by_stratum(of: Tally, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """AP, NLL, the share of all counted cells and that of occupied ones among them, of each stratum."""
    out = {}
    for name, histogram, lost in zip(names, of.histogram[1:], of.surprise[1:], strict=True):
        cells = float(histogram.sum())
        out[name] = {
            "ap": float(precision_area(histogram)),
            "nll": ratio(float(lost), cells),
            "cells": ratio(cells, float(of.said[1])),
            "occupied": ratio(float(histogram[1].sum()), cells),
        }
    return out


def resampled(towns: Sequence[Tally], draws: Counts) -> dict[str, Floats]:
    """(RESAMPLED,) of each headline figure, with the towns drawn as `resamples` says: the same draws for all methods, so pairs compare."""
    histogram = np.tensordot(draws.astype(float), np.stack([town.histogram[0] for town in towns]).astype(float), axes=1)  # floats: BLAS
    counts = np.tensordot(draws, np.stack([town.overlap for town in towns]), axes=1)
    cells = draws @ np.array([town.said[1] for town in towns])
    table = np.tensordot(draws, np.stack([town.reliability for town in towns]), axes=1)
    return {
        "ap": precision_area(histogram),
        "iou": counts[:, 0] / np.maximum(counts.sum(axis=1), 1),
        "nll": draws @ np.array([town.surprise[0] for town in towns]) / np.maximum(cells, 1),
        "ece": np.abs(table[:, 1] - table[:, 2]).sum(axis=1) / np.maximum(cells, 1),
    }
