"""Learned and analytic maps of one recorded drive, scored beside each other."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.map.look_map import LookMap
from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid_training.evaluation.metrics import ratio
from echogrid_training.evaluation.recorded.annotated import Annotated, Scene, score
from echogrid_training.evaluation.recorded.annotated import asked as asked_of
from echogrid_training.evaluation.recorded.drive import RealDrive
from echogrid_training.evaluation.recorded.elfes import plain_elfes
from echogrid_training.evaluation.recorded.scores import (
    FREE,
    OCCUPIED,
    Free,
    Occupied,
    Rectangle,
    Said,
    at_area,
    at_free_area,
    at_share,
    free_at,
    occupied_at,
    say,
    swept_ground,
)

ANALYTIC = "analytic"
YARDSTICKS = ("elfes", ANALYTIC)  # the reference scores' plain Elfes, and the service's own analytic model
PICTURED = 1280  # cells, 300 m


@dataclass(frozen=True, slots=True)
class Compared:
    """A method's half map at the areas of a yardstick's, and at the thresholds that were so chosen on the first recording."""

    equal_area: Occupied
    equal_share: Occupied  # of what each map itself has observed
    equal_free_area: Free
    first_occupied: Occupied
    first_free: Free


@dataclass(frozen=True, slots=True)
class MethodScores:
    swept: float  # share of the swept ground that the map of all scans calls occupied
    observed_m2: float  # this and what follows: of the half map
    within_reach: float  # share of the left-out detections on or beside observed cells: no threshold has a higher recall
    occupied: Occupied  # at OCCUPIED
    free: Free  # at FREE
    against: dict[str, Compared]  # by yardstick


@dataclass(frozen=True, slots=True)
class DriveScores:
    name: str
    driven_m: float
    swept_m2: float
    left_out: int  # detections
    methods: dict[str, MethodScores]
    annotated: dict[str, Scene]  # the map of all scans beside annotated truth, by method; empty where there is none


@dataclass(frozen=True, slots=True, eq=False)
class HalfMaps:
    """What a picture shows: half maps around the middle of the drive."""

    where: Rectangle  # at most PICTURED cells wide
    driven: Floats  # (N, 2) m in odom
    left_out: Floats  # (T, 2) m
    log_odds: dict[str, LogOdds]  # (H, W) by method


def compare(
    name: str, drive: RealDrive, model: str, first: DriveScores | None, *, summed: bool, truth: Annotated | None = None
) -> tuple[DriveScores, HalfMaps]:
    """Every other scan of all radars, in order of time, makes the half map; the others judge it. `model`: default, paper or a file's path.

    `first`: whose thresholds are tried here too; None: this is the first. Raises EchogridError.
    """
    if not drive.scans:
        raise EchogridError(f"{name}: none of its scans is between samples of speed and yaw rate, so none can be placed")
    where = Rectangle.around(drive.driven, load_config(drive.config).grid.cell)
    swept = swept_ground(drive.driven, where)
    asked = drive.scans[1::2]
    left_out = np.concatenate([np.empty((0, 2)), *(scan.points for scan in drive.reflections(asked))])
    pictured = where.cut(drive.driven[len(drive.driven) // 2], PICTURED)
    top, left = pictured.row - where.row, pictured.column - where.column
    said, halves = dict[str, Said](), dict[str, LogOdds]()
    for method, log_odds in maps(drive, model, where, {(scan.sensor, scan.stamp_ns) for scan, _ in asked}, summed=summed):
        said[method] = say(log_odds, where, swept, left_out)
        halves[method] = log_odds[top : top + pictured.height, left : left + pictured.width].copy()  # the whole may be a gigabyte
    cells = None if truth is None else asked_of(truth, drive.driven)
    methods, annotated = dict[str, MethodScores](), dict[str, Scene]()
    for method, log_odds in maps(drive, model, where, summed=summed):
        if cells is not None:
            annotated[method] = score(log_odds, where, cells)
        methods[method] = MethodScores(
            swept=occupied_at(say(log_odds, where, swept, left_out), OCCUPIED).swept,
            observed_m2=len(said[method].observed) * where.cell**2,
            within_reach=occupied_at(said[method], -math.inf).recall,
            occupied=occupied_at(said[method], OCCUPIED),
            free=free_at(said[method], FREE),
            against={one: compared(said[method], said[one], first.methods[method].against[one] if first else None) for one in YARDSTICKS},
        )
    driven = np.array([(ego.odom_from_base.x, ego.odom_from_base.y) for ego in drive.driven])
    length = float(np.hypot(*np.diff(driven, axis=0).T).sum())
    scores = DriveScores(name, length, int(swept.sum()) * where.cell**2, len(left_out), methods, annotated)
    return scores, HalfMaps(pictured, driven, left_out, halves)


def compared(said: Said, yardstick: Said, first: Compared | None) -> Compared:
    occupied, free = occupied_at(yardstick, OCCUPIED), free_at(yardstick, FREE)
    equal_area, equal_free = at_area(said, occupied.covered_m2), at_free_area(said, free.free_m2)
    return Compared(
        equal_area,
        at_share(said, occupied.covered_share),
        equal_free,
        occupied_at(said, first.equal_area.threshold) if first else equal_area,
        free_at(said, first.equal_free_area.threshold) if first else equal_free,
    )


def maps(
    drive: RealDrive, model: str, where: Rectangle, left_out: Collection[tuple[str, int]] = (), *, summed: bool
) -> Iterator[tuple[str, LogOdds]]:
    """By each method, without some scans: plain Elfes, the analytic model, the network's two layers, its own alone, and perhaps its sum."""
    shown = [one for one in drive.scans if (one[0].sensor, one[0].stamp_ns) not in left_out]
    yield "elfes", plain_elfes(drive.reflections(shown), where)
    yield ANALYTIC, where.read(drive.mapped(load_config(drive.config, "analytic"), left_out))
    looks = drive.mapped(by_rule(drive.config, model, "looks"), left_out)
    yield "looks", where.read(looks)
    if isinstance(looks, LookMap):
        yield "learned", where.read(looks, looks.learned)
    if summed:
        yield "sum", where.read(drive.mapped(by_rule(drive.config, model, "sum"), left_out))


def by_rule(path: Path, model: str, fusion: str) -> Config:
    config = load_config(path, model)
    return msgspec.structs.replace(config, map=msgspec.structs.replace(config.map, fusion=fusion))


LEAST_AP, LEAST_RECALL, MOST_FALSE_FREE = 1.4, 0.9, 0.02  # of a drive beside the analytic model; the last is a difference of shares
JUDGED_BY_AP = 0.005  # share of occupied cells from which a drive's average precision is more than chance


@dataclass(frozen=True, slots=True)
class Beside:
    """One method beside the analytic model on one drive, at the published thresholds."""

    ap: float  # ratio, beside annotated truth; NaN where there is none or too little of it is occupied
    recall: float  # ratio, of left-out detections
    false_free: float  # difference of shares

    @property
    def kept(self) -> bool:
        """Within the bounds that a map has to keep on every drive; a ratio that is no number keeps none, but for `ap`."""
        return (math.isnan(self.ap) or self.ap >= LEAST_AP) and self.recall >= LEAST_RECALL and self.false_free <= MOST_FALSE_FREE


def beside(drive: DriveScores, method: str) -> Beside:
    mine, its = drive.methods[method], drive.methods[ANALYTIC]
    ap = math.nan
    if drive.annotated:
        truth = drive.annotated[ANALYTIC]
        if truth.occupied >= JUDGED_BY_AP * (truth.occupied + truth.free):
            ap = ratio(drive.annotated[method].ap, truth.ap)
    return Beside(ap, ratio(mine.occupied.recall, its.occupied.recall), mine.free.false_free - its.free.false_free)


@dataclass(frozen=True, slots=True)
class Summary:
    """A method beside a yardstick over all drives: ratios to the yardstick unless said otherwise.

    Of `first` at the first drive's thresholds, over the others; NaN where there are none.
    """

    method: str
    yardstick: str
    swept_more: float  # the largest excess of its share of the swept ground called occupied
    recall: float  # mean, at equal areas
    recall_least: float
    recall_share: float  # mean, at equal shares of what each map itself has observed
    recall_first: float
    covered_first: float  # the area that these thresholds cover
    false_free: float  # of the means, at equal areas
    false_free_more: float  # the largest excess
    false_free_first: float
    free_first: float  # the area that these thresholds call free


def summaries(scores: list[DriveScores]) -> list[Summary]:
    return [summary(scores, method, yardstick) for yardstick in YARDSTICKS for method in scores[0].methods if method != yardstick]


def summary(scores: list[DriveScores], method: str, yardstick: str) -> Summary:
    mine, theirs = ([drive.methods[one] for drive in scores] for one in (method, yardstick))
    pairs = [(one.against[yardstick], its) for one, its in zip(mine, theirs, strict=True)]
    recall = [ratio(one.equal_area.recall, its.occupied.recall) for one, its in pairs]
    return Summary(
        method,
        yardstick,
        swept_more=max(one.swept - its.swept for one, its in zip(mine, theirs, strict=True)),
        recall=mean(recall),
        recall_least=min(recall),
        recall_share=mean([ratio(one.equal_share.recall, its.occupied.recall) for one, its in pairs]),
        recall_first=mean([ratio(one.first_occupied.recall, its.occupied.recall) for one, its in pairs[1:]]),
        covered_first=mean([ratio(one.first_occupied.covered_m2, its.occupied.covered_m2) for one, its in pairs[1:]]),
        false_free=ratio(sum(one.equal_free_area.false_free for one, _ in pairs), sum(its.free.false_free for _, its in pairs)),
        false_free_more=max(one.equal_free_area.false_free - its.free.false_free for one, its in pairs),
        false_free_first=ratio(sum(one.first_free.false_free for one, _ in pairs[1:]), sum(its.free.false_free for _, its in pairs[1:])),
        free_first=mean([ratio(one.first_free.free_m2, its.free.free_m2) for one, its in pairs[1:]]),
    )


def mean(values: list[float]) -> float:
    return ratio(sum(values), len(values))
