"""How methods fare as radars change: with their density, their mounting, and with some of them silent. Short drives of its own, kept.

Which threshold overlaps best depends on how much can be found at all: with calibrated probabilities it is half of the F score that it
reaches (Lipton, Elkan, Naryanaswamy, "Optimal Thresholding of Classifiers to Maximize F1 Measure", 2014). So maps are compared by average
precision, by IoU at the threshold that is best in other towns with the same radars, and by IoU at one threshold for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from echogrid_training.drives.drive import write_drive
from echogrid_training.drives.simulate import simulate
from echogrid_training.evaluation.metrics import best_bin, iou, overlaps
from echogrid_training.evaluation.simulated.baselines import BASELINES, MEAN_PATCH
from echogrid_training.evaluation.simulated.calibrating import Plan
from echogrid_training.evaluation.simulated.judging import Book, judge_patches
from echogrid_training.evaluation.simulated.learned import Key, networks
from echogrid_training.evaluation.simulated.maps import Geometry, drive_through, rows
from echogrid_training.evaluation.simulated.results import REFERENCE
from echogrid_training.evaluation.simulated.tally import Tally, figures, summed
from echogrid_training.evaluation.simulated.tape import load_tape
from echogrid_training.recording import RadarMount
from echogrid_training.sensors.episode import Episode, draw_episode, paper_like
from echogrid_training.worlds.layout import make_town

DENSITIES = (2, 4, 8, 16, 32, 64)  # detections of a radar's scan
MOUNTINGS = 3  # drawn
LOST = (0, 1, 2, 3)  # radars
TOWNS, SECONDS, PATCHES = 3, 20.0, 30
FAMILY, OTHERS = "test", "train"  # of the towns that are judged by, and of those that thresholds are chosen on
SEED = 7000  # of the first town: no campaign's


@dataclass(frozen=True, slots=True)
class Point:
    """One drive of the sweep: what is varied, to what, and in which of a family's TOWNS."""

    what: str
    value: str
    town: int
    family: str = FAMILY

    @property
    def folder(self) -> str:
        return f"{self.what}-{self.value}-{self.family}-{self.town}".replace(" ", "_")


Swept = tuple[Point, dict[str, dict[Key, Tally]]]


def points() -> list[Point]:
    """All drives of the sweep."""
    values = [("density", str(density)) for density in DENSITIES]
    values += [("mounting", str(number)) for number in range(MOUNTINGS)] + [("silent radars", str(lost)) for lost in LOST]
    return [Point(what, value, town, family) for what, value in values for family in (FAMILY, OTHERS) for town in range(TOWNS)]


def episode(point: Point) -> Episode:
    """The paper's radars, but for what is varied."""
    seed = SEED + point.town
    plain = paper_like(seed)
    if point.what == "density":
        return replace(plain, density=float(point.value))
    if point.what == "mounting":
        drawn = draw_episode(SEED + 100 + int(point.value), FAMILY)
        corners = [
            replace(corner, mount=RadarMount(corner.mount.name, other.mount.base_from_sensor, corner.mount.fov))
            for corner, other in zip(plain.corners, drawn.corners, strict=True)
        ]
        return replace(plain, corners=tuple(corners), body=drawn.body)
    corners = [
        replace(corner, lost=(0.0, 1.0)) if index < int(point.value) else corner
        for index, corner in enumerate(sorted(plain.corners, key=lambda corner: corner.mount.name[::-1]))
    ]
    return replace(plain, corners=tuple(corners))


def swept(point: Point, folder: Path, plan: Plan) -> Swept:
    """Sums by "patch" and "around" over one drive, of OTHERS by "around" alone; simulated unless it is there. Raises EchogridError."""
    drive = folder / point.folder
    if not drive.is_dir():
        recording, truth = simulate(make_town(point.family, SEED + point.town, SECONDS), episode(point))
        write_drive(recording, drive, seed=SEED, truth_map=truth)
    tape, book = load_tape(drive), Book(plan)
    learned = networks(plan.files, tape.mounts)
    if point.family == FAMILY:
        judge_patches(tape, plan, learned, PATCHES, book)
    for view in drive_through(tape, rows(tape, Geometry(tape), learned, plan.elfes)):
        if view.level == "around":
            book.add_view(view.level, view)
    return point, book.tallies


def curves(of: Sequence[Swept]) -> dict[str, dict[str, dict[str, dict[str, float]]]]:
    """By what is varied and its value, then by figure, then by method: Elfes' and the networks', of these the first seeds'."""
    out: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    for what, value in dict.fromkeys((point.what, point.value) for point, _ in of):
        here = [(point.family, tallies) for point, tallies in of if (point.what, point.value) == (what, value)]
        judged, others = ([tallies for family, tallies in here if (family == FAMILY) is asked] for asked in (True, False))
        patch, around, elsewhere = pooled(judged, "patch"), pooled(judged, "around"), pooled(others, "around")
        out.setdefault(what, {})[value] = {
            "AP": {name: figures(one)["ap"] for name, one in patch.items()},
            "AP of the map": {name: figures(one)["ap"] for name, one in around.items()},
            "IoU of the map": {name: _iou(one, elsewhere[name]) for name, one in around.items()},
            "IoU at one threshold": {name: figures(one)["iou"] for name, one in around.items()},
        }
    return out


def pooled(of: Sequence[dict[str, dict[Key, Tally]]], level: str) -> dict[str, Tally]:
    """Over drives, by method, of those that are compared."""
    return {key[0]: summed([tallies[level][key] for tallies in of]) for key in of[0][level] if _compared(key)}


def _iou(of: Tally, others: Tally) -> float:
    """At the threshold that is best for the others."""
    counts = overlaps(of.histogram[0])[:, best_bin(others.histogram[0])]
    return iou(counts)


def _compared(key: Key) -> bool:
    """Not every baseline, nor a map's layers alone."""
    name, seed = key
    plain = name in BASELINES or name == MEAN_PATCH
    return seed == 0 and "layer" not in name and (name in REFERENCE.values() or not plain)
