"""What a learned sensor model has to beat: plain methods, each with its few parameters, from a patch's detections to scores.

A score is log-odds of occupied or something that rises with them; reading.py makes log-odds of it. 0 is where a method says nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from echogrid.core.evidence.history_raster import COUNT
from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.evidence.raster import Image
from echogrid.core.messages import Floats
from echogrid_training.evaluation.reading import Scores
from echogrid_training.evaluation.simulated.beams import traced
from echogrid_training.evaluation.simulated.patches import Patch
from echogrid_training.evaluation.simulated.regression import Cells, GaussianProcess, HilbertMap
from echogrid_training.learning.dataset import SPEC


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """`scores` (H, W); `label` (H, W) in [-1, 1], as the paper's networks answer, where the method has such an answer."""

    scores: Scores
    label: Image | None = None

    @staticmethod
    def of_log_odds(log_odds: Scores) -> Answer:
        return Answer(log_odds, np.tanh(log_odds / 2))


Method = Callable[[Patch], Answer]


@dataclass(frozen=True)
class Nothing:
    """Says unknown everywhere."""

    def __call__(self, patch: Patch) -> Answer:
        return Answer.of_log_odds(np.zeros_like(patch.place.truth))


@dataclass(frozen=True, eq=False)
class MeanPatch:
    """The mean of the true patches of other towns: what streets look like around a car, whatever the radars see."""

    log_odds: Scores  # (H, W) of occupied among the observed
    label: Image  # (H, W), mean of -1, 0 and 1

    def __call__(self, patch: Patch) -> Answer:
        return Answer(self.log_odds, self.label)


def mean_patch(free: Floats, occupied: Floats, patches: int, blur: float = 2.0) -> MeanPatch:
    """Of how often each cell (H, W) was free and occupied in so many patches, smoothed by `blur` cells."""
    free, occupied = gaussian_filter(free, blur), gaussian_filter(occupied, blur)
    log_odds = np.log((occupied + 0.02) / (free + 0.5)).astype(np.float32)
    return MeanPatch(log_odds, ((occupied - free) / patches).astype(np.float32))


@dataclass(frozen=True)
class Delta:
    """Occupied where a detection lies, the more the more often; nothing elsewhere. `channel`: one of history_raster's counts."""

    channel: str

    def __call__(self, patch: Patch) -> Answer:
        plane = patch.plane(self.channel)
        return Answer(plane.astype(np.float32), (plane > 0).astype(np.float32))


@dataclass(frozen=True)
class Counting:
    """The reflection map: of the rays that came to a cell, the share that ended there, of the last 5 m; `prior` of each is added."""

    hits: str  # of history_raster's counts
    prior: float

    def __call__(self, patch: Patch) -> Answer:
        hits, passes = (np.searchsorted(COUNT, patch.plane(channel)).astype(np.float32) for channel in (self.hits, "passes_5m"))
        log_odds = np.log((hits + self.prior) / (passes + self.prior)).astype(np.float32)
        log_odds[log_odds == 0] = np.finfo(np.float32).tiny
        return Answer.of_log_odds(np.where(hits + passes > 0, log_odds, np.float32(0)))


@dataclass(frozen=True)
class Elfes:
    """The service's analytic model, each beam from where it was measured: of the newest scans, or of all detections of the last 15 m.

    The sum is clamped, as a map's is.
    """

    history: bool
    beam: BeamModel
    clamp: float

    def __call__(self, patch: Patch) -> Answer:
        passed, ended = _traced(patch, self.history, self.beam.beam_sigma)
        total = self.beam.free * passed + self.beam.occupied * ended
        return Answer.of_log_odds(np.clip(total, -self.clamp, self.clamp).astype(np.float32))


@lru_cache(maxsize=8)
def _traced(patch: Patch, history: bool, beam_sigma: float) -> Floats:
    detections = patch.around.past if history else patch.around.now
    return traced(detections.points, detections.origins, SPEC, BeamModel(beam_sigma=beam_sigma))


@dataclass(frozen=True)
class NearestFill:
    """The nearer a detection of the last 15 m, the more likely occupied: exp(-distance / length)."""

    length: float  # m
    least: int  # map updates that must have had a detection in a cell before it counts

    def __call__(self, patch: Patch) -> Answer:
        hit = patch.plane("updates_15m") >= COUNT[self.least]
        if not hit.any():
            return Answer(np.zeros(hit.shape, dtype=np.float32))
        distance = distance_transform_edt(~hit) * SPEC.cell
        return Answer(np.exp(-distance / self.length).astype(np.float32))


@dataclass(frozen=True)
class Regressed:
    """A regression on occupied cells, those with a detection of the last 15 m, and as many free points along the detections' rays."""

    model: GaussianProcess | HilbertMap

    def __call__(self, patch: Patch) -> Answer:
        cells, values = observations(patch)
        if not len(cells):
            return Answer.of_log_odds(np.zeros_like(patch.place.truth))
        scores = self.model(cells, values, SPEC)
        label = np.clip(scores, -1, 1) if isinstance(self.model, GaussianProcess) else np.tanh(scores / 2)
        return Answer(scores, label)


MARGIN = 2.0  # cells before a detection that its ray says nothing about


@lru_cache(maxsize=1)
def observations(patch: Patch) -> tuple[Cells, Floats]:
    """Flat cells (N,), and 1 for occupied and -1 for free (N,): every cell that was hit once, and as many free points in their cells."""
    past, rng = patch.around.past, np.random.default_rng(len(patch.around.past))
    cells = SPEC.locate(past.points)
    occupied = np.unique(cells[cells >= 0])
    ray = rng.integers(len(past), size=4 * len(occupied)) if len(past) else np.empty(0, dtype=np.int64)
    way = past.points[ray] - past.origins[ray]
    distance = np.hypot(way[:, 0], way[:, 1])
    share = rng.uniform(size=len(ray)) * np.maximum(1 - MARGIN * SPEC.cell / np.maximum(distance, 1e-6), 0)
    free = SPEC.locate(past.origins[ray] + share[:, None] * way)
    free = free[free >= 0][: len(occupied)]
    return np.concatenate((occupied, free)), np.repeat((1.0, -1.0), (len(occupied), len(free)))


LENGTHS = (0.15, 0.25, 0.35, 0.5, 0.8, 1.2)  # m
BASELINES: dict[str, tuple[Method, ...]] = {  # by name, the methods among which the calibration towns choose
    "all unknown": (Nothing(),),
    "delta, now": (Delta("now"),),
    "delta, 15 m": (Delta("count_15m"), Delta("updates_15m")),
    "counting": tuple(Counting(hits, prior) for hits in ("count_5m", "count_15m", "updates_15m") for prior in (0.1, 0.5, 2.0)),
    **{
        name: tuple(
            Elfes(history, BeamModel(free=free, beam_sigma=sigma), clamp)
            for sigma in (0.009, 0.018, 0.036)  # rad
            for free in (-0.06, -0.12, -0.24, -0.48)
            for clamp in (2.0, 3.5, 7.0)
        )
        for name, history in (("Elfes, now", False), ("Elfes, 15 m", True))
    },
    "nearest fill": tuple(NearestFill(length, least) for length in (0.35, 0.5, 0.7, 1.0, 1.4) for least in (1, 2)),
    "Gaussian process": tuple(Regressed(GaussianProcess(length, noise)) for length in LENGTHS for noise in (0.5, 1.0, 2.0)),
    "Hilbert map": tuple(Regressed(HilbertMap(length, ridge)) for length in LENGTHS for ridge in (0.03, 0.1, 0.3, 1.0)),
}
MEAN_PATCH = "mean patch"  # the baseline that is made of the calibration towns themselves
