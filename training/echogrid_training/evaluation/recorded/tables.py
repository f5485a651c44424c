"""The scores of real recordings as tables in Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

from echogrid.core.map.tiled_map import FREE, OCCUPIED
from echogrid_training.evaluation.metrics import ratio
from echogrid_training.evaluation.recorded.annotated import LEAST, MOST, TITLES, by_kind, figures, intervals, missed
from echogrid_training.evaluation.recorded.astyx import FrameScores
from echogrid_training.evaluation.recorded.comparison import (
    ANALYTIC,
    LEAST_AP,
    LEAST_RECALL,
    MOST_FALSE_FREE,
    YARDSTICKS,
    Compared,
    DriveScores,
    MethodScores,
    Summary,
    beside,
)

CALLED = (
    "drive",
    "method",
    "swept ground called occupied",
    "observed",
    "left-out detections within reach",
    "called occupied, widened",
    "recall",
    "called surely free",
    "false free",
)
EQUAL = (
    "drive",
    "method",
    "recall at equal area",
    "at equal share",
    "at the first's threshold (area)",
    "false free at equal area",
    "at the first's threshold (area)",
)
SUMMARY = (
    "method / yardstick",
    "swept ground, most more",
    "recall at equal area",
    "least",
    "at equal share",
    "at the first's threshold (area)",
    "false free at equal area",
    "most more",
    "at the first's threshold (area)",
)
BESIDE = ("drive", "method", "average precision", "recall", "false free", "bounds")
POOLED = ("figure", "method", "value", "95 % of draws of drives", "bound")
KINDS = ("kind", "method", "objects", "found", "called free")
FRAMES = ("file", "frames", "radar", "occupied", "method", "average precision", "to Elfes")


def drive_tables(scores: Sequence[DriveScores], summaries: Sequence[Summary]) -> str:
    """What the maps say as they are, then at the areas of each yardstick, then over all drives."""
    parts = [f"As the maps call it, occupied where p > {OCCUPIED:g} and free where p < {FREE:g}:"]
    parts.append(table(CALLED, (_called(drive.name, method, one) for drive, method, one in _all(scores))))
    parts.append(
        f"Beside '{ANALYTIC}', which every drive has to keep: average precision ≥ {LEAST_AP} times its, recall ≥ {LEAST_RECALL} times its, "
        f"false free ≤ {100 * MOST_FALSE_FREE:g} points more:"
    )
    parts.append(table(BESIDE, (_beside(drive, method) for drive, method, _ in _all(scores) if method != ANALYTIC)))
    for yardstick in YARDSTICKS:
        parts.append(f"At the areas of '{yardstick}':")
        rows = (_equal(drive.name, method, one.against[yardstick]) for drive, method, one in _all(scores) if method != yardstick)
        parts.append(table(EQUAL, rows))
    parts.append("Over all drives, ratios to the yardstick where nothing else is said:")
    parts.append(table(SUMMARY, map(_summary, summaries)))
    return "\n\n".join(parts)


def annotated_tables(scores: Sequence[DriveScores]) -> str:
    """Maps beside annotated truth, all drives together with intervals, then by drive and by kind of object. At least one drive."""
    by_method = {method: [drive.annotated[method] for drive in scores] for method in scores[0].annotated}
    yardstick = figures(by_method[ANALYTIC])
    rows, kinds = [], []
    for method, scenes in by_method.items():
        of, spread = figures(scenes), intervals(scenes)
        missing = missed(of, yardstick)
        for name, title in TITLES.items():
            low, high = spread[name]
            verdict = "" if name not in LEAST and name not in MOST else "missed" if name in missing else "kept"
            rows.append((title, method, f"{getattr(of, name):.4f}", f"{low:.4f} … {high:.4f}", verdict))
        kinds += [(kind, method, *map(str, counts)) for kind, counts in by_kind(scenes).items()]
    drives = [
        (drive.name, method, *(f"{getattr(figures([scene]), name):.4f}" for name in TITLES))
        for drive in scores
        for method, scene in drive.annotated.items()
    ]
    parts = ["Beside annotated truth, as published, all drives together:", table(POOLED, rows)]
    parts += ["By drive:", table(("drive", "method", *TITLES.values()), drives), "By kind of object:", table(KINDS, kinds)]
    return "\n\n".join(parts)


def frame_table(scores: Sequence[FrameScores]) -> str:
    """By file, place of the radar, and method."""
    return table(FRAMES, (row for one in scores for row in _frames(one)))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, ["---"] * len(head), *rows))


def _all(scores: Sequence[DriveScores]) -> Iterator[tuple[DriveScores, str, MethodScores]]:
    for drive in scores:
        for method, one in drive.methods.items():
            yield drive, method, one


def _called(drive: str, method: str, one: MethodScores) -> list[str]:
    occupied, free = one.occupied, one.free
    said = [f"{one.swept:.3%}", f"{one.observed_m2:.0f} m²", f"{one.within_reach:.2f}", f"{occupied.covered_m2:.0f} m²"]
    return [drive, method, *said, f"{occupied.recall:.3f}", f"{free.free_m2:.0f} m²", f"{free.false_free:.2%}"]


def _beside(drive: DriveScores, method: str) -> list[str]:
    one = beside(drive, method)
    return [
        drive.name,
        method,
        _or_none(one.ap, ".2f"),
        f"{one.recall:.2f}",
        f"{100 * one.false_free:+.1f}",
        "kept" if one.kept else "missed",
    ]


def _equal(drive: str, method: str, one: Compared) -> list[str]:
    occupied = [f"{one.equal_area.recall:.3f}", f"{one.equal_share.recall:.3f}"]
    occupied.append(f"{one.first_occupied.recall:.3f} ({one.first_occupied.covered_m2:.0f} m²)")
    free = [f"{one.equal_free_area.false_free:.2%}", f"{one.first_free.false_free:.2%} ({one.first_free.free_m2:.0f} m²)"]
    return [drive, method, *occupied, *free]


def _summary(one: Summary) -> list[str]:
    occupied = [_or_none(value, ".2f") for value in (one.recall, one.recall_least, one.recall_share)]
    pairs = ((one.recall_first, one.covered_first), (one.false_free_first, one.free_first))
    first = [
        "–" if math.isnan(value) else f"{value:.2f} ({_or_none(area, '.2f')})" for value, area in pairs
    ]  # one drive alone has no first
    free = _or_none(one.false_free, ".2f"), _or_none(one.false_free_more, "+.2%")
    return [f"{one.method} / {one.yardstick}", _or_none(one.swept_more, "+.3%"), *occupied, first[0], *free, first[1]]


def _or_none(value: float, form: str) -> str:
    """A ratio to nothing is none."""
    return "–" if math.isnan(value) else format(value, form)


def _frames(one: FrameScores) -> Iterator[list[str]]:
    elfes = one.average_precision["elfes"]
    for method, value in one.average_precision.items():
        place = [one.name, f"{one.frames}", f"{one.place} patch", f"{one.occupied:.2%} of {one.cells} cells"]
        yield [*place, method, f"{value:.4f}", f"{ratio(value, elfes):.2f}"]
