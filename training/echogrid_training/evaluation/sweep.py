"""How methods fare as radars change: with their density, their mounting, and with some of them silent. Short drives of its own, kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from echogrid_training.drive import write_drive
from echogrid_training.episode import Episode, draw_episode, paper_like
from echogrid_training.evaluation.baselines import BASELINES, MEAN_PATCH
from echogrid_training.evaluation.calibrating import Plan
from echogrid_training.evaluation.judging import Book, judge_patches
from echogrid_training.evaluation.learned import Key, networks
from echogrid_training.evaluation.maps import Geometry, drive_through, rows
from echogrid_training.evaluation.results import REFERENCE
from echogrid_training.evaluation.tally import Tally, figures, summed
from echogrid_training.evaluation.tape import load_tape
from echogrid_training.layout import make_town
from echogrid_training.recording import RadarMount
from echogrid_training.simulate import simulate

DENSITIES = (2, 4, 8, 16, 32, 64)  # detections of a radar's scan
MOUNTINGS = 3  # drawn
LOST = (0, 1, 2, 3)  # radars
TOWNS, SECONDS, FAMILY, PATCHES = 2, 20.0, "test", 30
SEED = 7000  # of the first town: no campaign's


@dataclass(frozen=True, slots=True)
class Point:
    """One drive of the sweep: what is varied, to what, and in which of the TOWNS."""

    what: str
    value: str
    town: int

    @property
    def folder(self) -> str:
        return f"{self.what}-{self.value}-{self.town}".replace(" ", "_")


Swept = tuple[Point, dict[str, dict[Key, Tally]]]


def points() -> list[Point]:
    """All drives of the sweep."""
    values = [("density", str(density)) for density in DENSITIES]
    values += [("mounting", str(number)) for number in range(MOUNTINGS)] + [("silent radars", str(lost)) for lost in LOST]
    return [Point(what, value, town) for what, value in values for town in range(TOWNS)]


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
        return replace(plain, corners=tuple(corners), body=drawn.body)  # type: ignore[arg-type]
    corners = [
        replace(corner, lost=(0.0, 1.0)) if index < int(point.value) else corner
        for index, corner in enumerate(sorted(plain.corners, key=lambda corner: corner.mount.name[::-1]))
    ]
    return replace(plain, corners=tuple(corners))  # type: ignore[arg-type]


def swept(point: Point, folder: Path, plan: Plan) -> Swept:
    """Sums by "patch" and "around" over one drive, which is simulated unless it is there. Raises EchogridError."""
    drive = folder / point.folder
    if not drive.is_dir():
        recording, truth = simulate(make_town(FAMILY, SEED + point.town, SECONDS), episode(point))
        write_drive(recording, drive, seed=SEED, truth_map=truth)
    tape, book = load_tape(drive), Book(plan)
    learned = networks(plan.files, tape.mounts)
    judge_patches(tape, plan, learned, PATCHES, book)
    for view in drive_through(tape, rows(tape, Geometry(tape), learned)):
        if view.level == "around":
            book.add_view(view.level, view)
    return point, book.tallies


def curves(of: Sequence[Swept]) -> dict[str, dict[str, dict[str, dict[str, float]]]]:
    """By what is varied and its value: AP of single updates and IoU around the car, Elfes' and the networks', the first seeds'."""
    out: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    for point, _ in of:
        same = [tallies for other, tallies in of if (other.what, other.value) == (point.what, point.value)]
        row = {}
        for head, level, figure in (("AP", "patch", "ap"), ("IoU", "around", "iou")):
            keys = [key for key in same[0][level] if _compared(key)]
            row[head] = {key[0]: figures(summed([tallies[level][key] for tallies in same]))[figure] for key in keys}
        out.setdefault(point.what, {})[point.value] = row
    return out


def _compared(key: Key) -> bool:
    """Not every baseline, nor a map's layers alone."""
    name, seed = key
    plain = name in BASELINES or name == MEAN_PATCH
    return seed == 0 and "layer" not in name and (name in REFERENCE.values() or not plain)
