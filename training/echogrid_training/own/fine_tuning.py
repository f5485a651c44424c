"""What a network learns from drives that nobody labelled: images of half of the scans, and what the other half says of the same cells.

echogrid-train adapt default drives/* --out mine.onnx --simulated towns
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from echogrid.config.loading import load_config
from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.history_raster import Bytes, HistoryRaster
from echogrid.core.evidence.raster import Image
from echogrid.core.map.look_map import Calibration
from echogrid.core.mapper import MapUpdate
from echogrid.core.motion.odometry import EgoState
from echogrid_training.drives.samples import SPACING, Unwritten
from echogrid_training.evaluation.recorded.drive import RealDrive
from echogrid_training.learning.dataset import SPEC, SURE, UNJUDGED, Labels, Samples, joined
from echogrid_training.own.half import Key, driven_through, roomy
from echogrid_training.own.hindsight import Judged
from echogrid_training.own.patches import keep_kind, labels
from echogrid_training.recording import Track, untracked

LEAST = 300  # cells of a sample that have to be judged
EPOCHS, BATCH, RATE, PATIENCE, KEEP = 6, 32, 3e-4, 2, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """One map update of the half: the image, where the car was in the map's odom, and the stretch."""

    image: Bytes
    ego: EgoState
    stretch: int


def both(drive: RealDrive) -> Iterator[set[Key]]:
    """Every other scan in order of time, from the second and from the first on: each half is asked by the other once."""
    for first in (1, 0):
        yield {(scan.sensor, scan.stamp_ns) for scan, _ in drive.scans[first::2]}


def hindsight_samples(drives: Sequence[RealDrive], seed: int, track: Track = untracked) -> tuple[Samples, Samples]:
    """To learn from, and held out: the two kinds share no judged cell (patches.py)."""
    rng = np.random.default_rng(seed)
    kinds: dict[bool, list[Samples]] = {False: [], True: []}
    for drive in track(list(drives), "cutting samples"):
        for left_out in both(drive):
            for scored, part in cut(drive, left_out, rng):
                kinds[scored].append(part)
    return joined(kinds[False]), joined(kinds[True])


def cut(drive: RealDrive, left_out: set[Key], rng: np.random.Generator) -> Iterator[tuple[bool, Samples]]:
    """By stretch and kind; `rng` draws the labels by their chances, so that many samples of a cell teach its chance."""
    pipeline = roomy(drive, load_config(drive.config, "analytic"))  # its sensor model is not run
    mapper, raster = pipeline.mapper, HistoryRaster(SPEC, pipeline.mapper.mounts)
    around, shown, last = list[Surroundings](), list[Shown](), [-math.inf]

    def infer(now: Surroundings) -> Image:
        around[:] = [now]
        return Image((0,))  # no map is made

    def seen(update: MapUpdate, stretch: int) -> None:
        way = mapper.odometry.distance
        if around and way - last[0] >= SPACING:
            last[0] = way
            shown.append(Shown(raster(around[0]), update.ego, stretch))
        around.clear()

    mapper.map, mapper.infer = Unwritten(SPEC, Calibration()), infer
    half = driven_through(drive, mapper, "", left_out, ask=False, seen=seen, lost=shown.clear)
    for stretch in sorted({one.stretch for one in shown}):
        here = [one for one in shown if one.stretch == stretch]
        judged, where = labels(half, [one.ego for one in here])
        for scored in (False, True):
            kept = Judged(judged.label.copy(), judged.chance.copy())
            keep_kind(kept, where, half, scored=scored)
            drawn = [(one.image, label_of(kept, one.ego, where.row, where.column, rng)) for one in here]
            enough = [(image, label) for image, label in drawn if np.count_nonzero(label != UNJUDGED) >= LEAST]
            part = Samples.empty(len(enough))
            for index, (image, label) in enumerate(enough):
                part.images[index], part.labels[index] = image, label
            yield scored, part


def label_of(judged: Judged, ego: EgoState, row: int, column: int, rng: np.random.Generator) -> Labels:
    """(H, W) around a pose: occupied as often as the chance of the cell in which a centre lies says, else free; or UNJUDGED.

    `row`, `column`: of the first judged cell.
    """
    cells = np.floor(ego.odom_from_base.apply(SPEC.centres().reshape(-1, 2)) / SPEC.cell).astype(np.int64) - (column, row)
    chance = judged.chance[cells[:, 1], cells[:, 0]]
    label = np.where(rng.uniform(size=len(chance)) < chance, SURE, -SURE)
    out: Labels = np.where(np.isnan(chance), UNJUDGED, label).astype(np.int8).reshape(SPEC.cells, SPEC.cells)
    return out


def tuned(
    parent: Path, samples: Samples, held_out: Samples, out: Path, calibration: Calibration, *, seed: int, epochs: int, track: Track
) -> list[Path]:
    """Goes on from the float file `parent`; the float and the int8 file, whose weights are halfway between. Raises EchogridError."""
    from echogrid_training.learning import export, fit, train, warm_start  # PyTorch is loaded when it runs, not before

    settings = train.Settings("default", epochs=epochs, seed=seed, batch=BATCH, rate=RATE)
    start = warm_start.started(parent, samples)
    trained = train.fit(samples, held_out, settings, out / "run", track=track, start=start, patience=PATIENCE)
    learned = export.export(trained, out / "learned", calibration)[0]
    trained = replace(trained, weights=warm_start.between(parent, learned, KEEP, samples))
    return export.export(trained, out / "between", calibration, fit.calibrating(samples))
