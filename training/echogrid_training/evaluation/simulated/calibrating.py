"""What is fixed on the calibration towns before a test town is looked at: baselines' parameters, readings, thresholds, the mean patch."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.inverse_sensor_model import BeamModel
from echogrid.core.messages import Floats
from echogrid_training.evaluation.metrics import Mask
from echogrid_training.evaluation.reading import Reading, Scores, fit_reading, unlikelihood
from echogrid_training.evaluation.simulated.baselines import BASELINES, MEAN_PATCH, Elfes, MeanPatch, Method, mean_patch
from echogrid_training.evaluation.simulated.learned import File, Key, lidar_networks, networks
from echogrid_training.evaluation.simulated.maps import TUNED, Geometry, drive_through, rows
from echogrid_training.evaluation.simulated.patches import patches
from echogrid_training.evaluation.simulated.tally import Place
from echogrid_training.evaluation.simulated.tape import load_tape
from echogrid_training.learning.dataset import SPEC

PATCHES = 24  # of a calibration drive
CELLS = 1000  # of a patch or a window, drawn of those that count
LEVELS = ("patch", "around", "finished")
SUMMED = tuple(  # of which the map is tuned, around the car
    Elfes(False, BeamModel(free=free, beam_sigma=sigma), clamp)
    for sigma in (0.009, 0.018, 0.036)
    for free in (-0.015, -0.03, -0.06, -0.12)
    for clamp in (1.0, 2.0, 3.5)
)


@dataclass(frozen=True, slots=True)
class Plan:
    """How test towns are judged. `readings` by level: of patches, around the car, of finished maps."""

    files: tuple[File, ...]
    methods: dict[Key, Method]  # the baselines, as tuned
    readings: dict[str, dict[Key, Reading]]
    elfes: tuple[Elfes, ...] = ()  # as tuned for maps; none where no map was made to tune it by


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """Scores of randomly drawn cells of one place, the same cells of all methods."""

    level: str
    cells: NDArray[np.intp]  # (N,) flat
    occupied: Mask  # (N,)
    scores: dict[Key, Scores]  # (N,) each; keys of baselines number the candidates, those of networks the seeds


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What one calibration drive shows: drawn cells, and how often each cell (H, W) of its patches was free and occupied."""

    drawn: list[Drawn]
    free: Floats
    occupied: Floats


def shown(folder: Path, files: Sequence[File], with_patches: bool, with_maps: bool) -> Shown:
    """All candidates on one drive's patches and all maps, what of them is asked for. Raises EchogridError."""
    tape, rng = load_tape(folder), np.random.default_rng(zlib.crc32(folder.name.encode()))
    learned, of_lidar = networks(files, tape.mounts), lidar_networks(files)
    out = Shown([], np.zeros((SPEC.cells, SPEC.cells)), np.zeros((SPEC.cells, SPEC.cells)))
    for patch in patches(tape, PATCHES) if with_patches else ():
        said = {(name, index): method(patch).scores for name, grid in BASELINES.items() for index, method in enumerate(grid)}
        said |= {key: network.answer(patch).scores for key, network in (learned | of_lidar).items()}
        out.drawn.append(draw("patch", patch.place, said, rng))
        out.free[:] += patch.place.truth < 0
        out.occupied[:] += patch.place.truth > 0
    if with_maps:
        for view in drive_through(tape, rows(tape, Geometry(tape), learned, SUMMED)):
            out.drawn.append(draw(view.level, view.place, view.scores, rng))
    return out


def draw(level: str, place: Place, scores: dict[Key, Scores], rng: np.random.Generator) -> Drawn:
    """CELLS of the place's cells that count, or all if they are fewer."""
    counted = np.flatnonzero(place.counted)
    cells = rng.choice(counted, min(CELLS, len(counted)), replace=False)
    picked = {key: score.reshape(-1)[cells] for key, score in scores.items()}
    return Drawn(level, cells, place.truth.reshape(-1)[cells] > 0, picked)


def planned(of: Sequence[Shown], files: Sequence[File]) -> Plan:
    """By all calibration drives together."""
    drawn = [one for part in of for one in part.drawn]
    free, occupied = np.sum([part.free for part in of], axis=0), np.sum([part.occupied for part in of], axis=0)
    methods: dict[Key, Method] = {}
    readings: dict[str, dict[Key, Reading]] = {level: {} for level in LEVELS}
    elfes: tuple[Elfes, ...] = ()
    for level, read in readings.items():
        some = [one for one in drawn if one.level == level]
        if not some:
            continue
        truth = np.concatenate([one.occupied for one in some])
        scores = {key: np.concatenate([one.scores[key] for one in some]) for key in some[0].scores}
        if level == "patch":
            for name, grid in BASELINES.items():
                best = int(np.argmin([unlikelihood(scores[name, index], truth) for index in range(len(grid))]))
                methods[name, 0], read[name, 0] = grid[best], fit_reading(scores[name, best], truth)
            mean = mean_patch(free, occupied, len(some))
            methods[MEAN_PATCH, 0], read[MEAN_PATCH, 0] = mean, fit_reading(_of_mean(mean, some), truth)
        if level == "around":
            best = int(np.argmin([unlikelihood(scores[TUNED, index], truth) for index in range(len(SUMMED))]))
            elfes = (SUMMED[best],)
        if elfes:
            read[TUNED, 0] = fit_reading(scores[TUNED, SUMMED.index(elfes[0])], truth)
        for key in scores:
            if key[0] not in BASELINES and key[0] != TUNED:
                read[key] = fit_reading(scores[key], truth)
    return Plan(tuple(files), methods, readings, elfes)


def _of_mean(mean: MeanPatch, drawn: Sequence[Drawn]) -> Scores:
    return np.concatenate([mean.log_odds.reshape(-1)[one.cells] for one in drawn])
