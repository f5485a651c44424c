"""The paper's large-scale map: a network's answers along a drive, put together at the true poses by one of three rules.

`endless` is the paper's Eq. (1), `sum` the same within a clamp, as in the service, `looks` the mean of the looks (docs/fusion.md). All take
the same updates, at most four of every half metre, so that they differ in the rule alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from echogrid.core.evidence.raster import Image
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid_training.drives.samples import samples
from echogrid_training.learning.dataset import SPEC, Samples, packed
from echogrid_training.learning.logistic import fit_logistic
from echogrid_training.truth.ground_truth import TruthMap
from echogrid_training.truth.simulated_truth import load_simulated_truth

Rule = Literal["endless", "sum", "looks"]
CLAMP = 3.5  # log-odds that a sum is kept within, as in the service


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """A simulated drive, update by update: what networks are shown, where the car truly was, and the true map."""

    name: str
    samples: Samples
    poses: list[SE2]  # of base, in the truth's frame
    truth: TruthMap

    @property
    def way(self) -> Floats:
        """(N, 2) m, in the truth's frame."""
        return np.array([(pose.x, pose.y) for pose in self.poses])


def driven(drive: Path) -> Driven:
    """All updates that the default map takes. Raises EchogridError."""
    cut = list(samples(drive, spacing=0.0, whole=True))
    if not cut:
        raise EchogridError(f"{drive}: gives no map update within the time of its truth, expected a drive to map")
    truth = load_simulated_truth(find_drive(drive, None).truth).map
    return Driven(drive.name, packed(cut), [sample.truth_from_base for sample in cut], truth)


def longest(drives: Sequence[Path]) -> Path:
    """The drive with the most way. Raises EchogridError."""
    return max(drives, key=lambda drive: way_length(load_simulated_truth(find_drive(drive, None).truth).poses))


def way_length(places: Floats) -> float:
    """m along places (N, 2 or more), of which the first two columns are x and y."""
    return float(np.hypot(*np.diff(places[:, :2], axis=0).T).sum())


def mapped(answers: Image, poses: Sequence[SE2], truth: TruthMap, rule: Rule) -> LogOdds:
    """The map of answers (n, 128, 128) at n poses, on the cells of the true one; 0 where nothing was said."""
    column, row = (round(place / truth.cell) for place in truth.origin)
    where = (row, column, *truth.log_odds.shape)
    if rule != "looks":
        total = OccupancyMap(SPEC, CLAMP if rule == "sum" else math.inf)
        for answer, pose in zip(answers, poses, strict=True):
            total.integrate(answer, pose)
        return total.window(*where)
    looks = LookMap(SPEC, Calibration())
    for answer, pose in zip(answers, poses, strict=True):
        looks.integrate(np.stack((answer, np.ones_like(answer))), pose)
    return looks.learned(looks.window_of_layers(*where))  # nothing was measured


@dataclass(frozen=True, slots=True)
class MapErrors:
    """Over the cells that both maps know. Bits: what the truth of a cell still costs to tell once the map's probability is known."""

    sure: float  # share of the cells with log-odds of CLAMP or more by amount
    sure_and_wrong: float  # share of those whose truth is the other
    bits: float
    fitted_bits: float  # after the best a * log-odds + b, which takes care of a shift by the class weights
    least: float  # bits of a map that says the share of occupied cells everywhere


def map_errors(log_odds: LogOdds, truth: LogOdds) -> MapErrors:
    """Of maps on the same cells (H, W), 0 for unknown. NaN where they share no cell."""
    both = (log_odds != 0) & (truth != 0)
    said, occupied = log_odds[both].astype(float), truth[both] > 0
    if not len(said):
        return MapErrors(*[np.nan] * 5)
    sure = np.abs(said) >= CLAMP
    features = np.stack((said, np.ones_like(said)))
    share = float(np.clip(occupied.mean(), 1e-9, 1 - 1e-9))

    def bits(z: Floats) -> float:
        return float(np.logaddexp(0.0, np.where(occupied, -z, z)).mean() / np.log(2))

    return MapErrors(
        sure=float(sure.mean()),
        sure_and_wrong=float(((said > 0) != occupied)[sure].mean()) if sure.any() else np.nan,
        bits=bits(said),
        fitted_bits=bits(fit_logistic(features, occupied, np.array([1.0, 0.0])) @ features),
        least=bits(np.full_like(said, np.log(share / (1 - share)))),
    )
