"""One drive measured without any truth: half of its scans make a map, the other half judges it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.map.tiled_map import probability
from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid_training.evaluation.metrics import ratio
from echogrid_training.evaluation.recorded.drive import RealDrive, hear
from echogrid_training.evaluation.recorded.scores import FREE, OCCUPIED, Rectangle, free_at, occupied_at, say, swept_ground
from echogrid_training.own.half import Answers, Half, halve
from echogrid_training.own.hindsight import judge
from echogrid_training.own.worth import binned

LEAST_WAY = 10.0  # m that a drive has to go


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What one model makes of one drive."""

    answers: Answers  # of the map as it stood when each scan came
    recall: float  # this and what follows: of the finished half map. Share of the left-out detections within a cell of an occupied one
    false_free: float  # share of them in cells called free
    left_out: int  # detections
    observed_m2: float
    occupied_m2: float
    free_m2: float
    swept: float  # share of the ground that the car drove over that the map of all scans calls occupied
    cells: Floats  # (3, BINS) by stated p of the half map: judged cells, the sum of p, those that hindsight calls occupied


@dataclass(frozen=True, slots=True, eq=False)
class DriveWorth:
    name: str
    seconds: float
    way: float  # m
    maps: int  # more than one: the way was lost in between, and finished maps are of what came after
    radars: tuple[str, ...]
    model: str  # which ran, and why
    by_model: dict[str, Measured]  # OURS and ANALYTIC


OURS, ANALYTIC = "model", "analytic"


def heard(source: Path, configuration: Path | None) -> tuple[RealDrive, Config]:
    """A drive that can be measured, and its configuration. Raises EchogridError."""
    drive = hear(source, configuration)
    if not drive.scans:
        raise EchogridError(f"{source}: none of its scans is between samples of speed and yaw rate, so none can be placed")
    places = np.array([(ego.odom_from_base.x, ego.odom_from_base.y) for ego in drive.driven])
    way = float(np.hypot(*np.diff(places, axis=0).T).sum())
    if way < LEAST_WAY:
        raise EchogridError(f"{source}: goes {way:.0f} m, expected at least {LEAST_WAY:g}: from one place nothing is seen twice")
    return drive, load_config(drive.config)


def every_other(drive: RealDrive) -> set[tuple[str, int]]:
    """In order of time: the scans that a half map is not shown."""
    return {(scan.sensor, scan.stamp_ns) for scan, _ in drive.scans[1::2]}


def measure(name: str, drive: RealDrive, model: str | None) -> DriveWorth:
    """`model` as in `--model`; None: the configuration's own. Raises EchogridError."""
    config = load_config(drive.config, model)
    half = halve(drive, config, every_other(drive))
    found = {OURS: measured(half, halve(drive, config, ()))}
    if config.model != ANALYTIC:
        plain = load_config(drive.config, ANALYTIC)
        found[ANALYTIC] = measured(halve(drive, plain, every_other(drive)), halve(drive, plain, ()))
    seconds = (drive.items[-1][0] - drive.items[0][0]) * 1e-9
    return DriveWorth(name, seconds, half.way, half.maps, tuple(radar.name for radar in config.radar), half.model, found)


def measured(half: Half, whole: Half) -> Measured:
    """`whole`: of all scans."""
    where = Rectangle.around(half.driven, half.map.spec.cell)
    log_odds = where.read(half.map)
    left_out = np.concatenate([np.empty((0, 2)), *half.left_out])
    said = say(log_odds, where, swept_ground(half.driven, where), left_out)
    occupied, free = occupied_at(said, OCCUPIED), free_at(said, FREE)
    label = judge([look.found for look in half.looks], half.driven, where).label
    asked = (label != 0) & (log_odds != 0)
    whole_where = Rectangle.around(whole.driven, whole.map.spec.cell)
    whole_said = whole_where.read(whole.map)[swept_ground(whole.driven, whole_where)]
    return Measured(
        answers=Answers.joined([Answers.empty(), *half.answers]),
        recall=occupied.recall,
        false_free=free.false_free,
        left_out=len(left_out),
        observed_m2=len(said.observed) * where.cell**2,
        occupied_m2=int((said.observed > OCCUPIED).sum()) * where.cell**2,
        free_m2=free.free_m2,
        swept=ratio(int(((whole_said > OCCUPIED) & (whole_said != 0)).sum()), len(whole_said)),
        cells=binned(probability(log_odds[asked]).astype(float), label[asked] > 0),
    )
