"""One test drive, judged: sums of every method's right and wrong, by level, and what is shown of it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.history_raster import Bytes
from echogrid.core.evidence.raster import Image
from echogrid.core.messages import Floats
from echogrid_training.evaluation.metrics import distances
from echogrid_training.evaluation.reading import Reading
from echogrid_training.evaluation.simulated.baselines import Answer
from echogrid_training.evaluation.simulated.calibrating import Plan
from echogrid_training.evaluation.simulated.learned import Key, Network, lidar_networks, networks
from echogrid_training.evaluation.simulated.maps import Geometry, View, drive_through, rows
from echogrid_training.evaluation.simulated.patches import Patch, patches
from echogrid_training.evaluation.simulated.probes import cold_starts, revisits, standstill
from echogrid_training.evaluation.simulated.tally import Place, Tally, summed, tally
from echogrid_training.evaluation.simulated.tape import Tape, load_tape
from echogrid_training.learning.dataset import town


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One window as every method sees it, side by side: calibrated log-odds (H, W), the first seeds'."""

    truth: Image
    detections: Bytes | None  # (2, H, W): counts now and of the last 15 m
    said: dict[str, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """`tallies` by level: "patch", "around", "finished", "revisited", and "after N looks" of a cold start."""

    drive: str
    town: str
    patches: int
    tallies: dict[str, dict[Key, Tally]]
    standstill: dict[Key, float]
    patch: Picture | None
    finished: Picture | None


class Book:
    """Remembers the sums by level and method."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.tallies: dict[str, dict[Key, Tally]] = {}

    def add(self, level: str, readings: dict[Key, Reading], place: Place, answers: Iterable[tuple[Key, Answer]]) -> None:
        """What all methods say of one place."""
        book, far = self.tallies.setdefault(level, {}), distances(place.truth > 0)
        for key, answer in answers:
            one = tally(answer.scores, answer.label, place, readings[key], far)
            book[key] = summed((book[key], one)) if key in book else one

    def add_view(self, level: str, view: View) -> None:
        readings = self.plan.readings["around" if view.level in ("around", "cold") else "finished"]
        self.add(level, readings, view.place, ((key, Answer.of_log_odds(scores)) for key, scores in view.scores.items()))


def judged(folder: Path, plan: Plan, count: int, probed: bool) -> Judged:
    """At most `count` patches of the drive, and its maps: those of cold starts too where patches are judged, and `probed`: also standing
    and driving it twice. Raises EchogridError."""
    tape, book = load_tape(folder), Book(plan)
    learned, geometry = networks(plan.files, tape.mounts), Geometry(tape)
    patch, number = judge_patches(tape, plan, learned, count, book) if count else (None, 0)
    of, finished = rows(tape, geometry, learned, plan.elfes), []
    for view in drive_through(tape, of):
        book.add_view(view.level, view)
        if view.level == "finished":
            finished.append(view)
    for looks, view in cold_starts(tape, geometry, learned, plan.elfes) if count else ():
        book.add_view(f"after {looks} looks", view)
    if probed:
        for view in revisits(tape, of):
            book.add_view(view.level, view)
    stood = standstill(tape, geometry, learned) if probed else {}
    middle = finished[len(finished) // 2] if finished else None
    return Judged(folder.name, town(folder), number, book.tallies, stood, patch, None if middle is None else _view_shown(middle, plan))


def judge_patches(tape: Tape, plan: Plan, learned: dict[Key, Network], count: int, book: Book) -> tuple[Picture | None, int]:
    """Into the book; returns the middle patch as a picture, and how many there were."""
    readings, picture, number = plan.readings["patch"], None, 0
    every = learned | lidar_networks(plan.files)
    for number, patch in enumerate(patches(tape, count), start=1):
        answers = {key: method(patch) for key, method in plan.methods.items()}
        answers |= {key: network.answer(patch) for key, network in every.items()}
        book.add("patch", readings, patch.place, answers.items())
        if number == count // 2 + 1 or picture is None:
            picture = _patch_shown(patch, {key: readings[key](answer.scores) for key, answer in answers.items()})
    return picture, number


def _patch_shown(patch: Patch, log_odds: dict[Key, NDArray[np.float64]]) -> Picture:
    planes = np.stack((patch.plane("now"), patch.plane("count_15m")))
    return Picture(patch.place.truth, planes, {name: said for (name, seed), said in log_odds.items() if seed == 0})


def _view_shown(view: View, plan: Plan) -> Picture:
    readings = plan.readings["finished"]
    said = {key[0]: readings[key](scores) for key, scores in view.scores.items() if key[1] == 0}
    return Picture(view.place.truth, None, said)
