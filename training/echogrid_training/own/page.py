"""What the map is worth on a car, as one HTML page: the answer first, in words, then the figures that it rests on."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence

import numpy as np

from echogrid.core.map.tiled_map import FREE, OCCUPIED
from echogrid.judging.pages.page import STYLE
from echogrid.judging.pages.plot import Curve, plot
from echogrid_training.own.half import STRETCH, Answers
from echogrid_training.own.measure import ANALYTIC, OURS, DriveWorth
from echogrid_training.own.worth import Live, Share, by_age, by_radar, by_range, diagram, live, points

TABLE = """
table { border-collapse: collapse; margin: .6rem 0 1.2rem; display: block; max-width: 100%; overflow-x: auto }
td, th { padding: .25rem .7rem; text-align: right; border-bottom: 1px solid #8a929c55 }
td:first-child, th:first-child { text-align: left } .big { font-size: 1.6rem; font-weight: 600 }
"""


def page_of(drives: Sequence[DriveWorth], title: str) -> str:
    """At least one drive. It needs no other file."""
    asked = {model: joined(drives, model) for model in drives[0].by_model}
    body = [
        f"<h1>{html.escape(title)}</h1>",
        _opening(drives, asked),
        *_drives(drives),
        *_parts(drives, asked[OURS]),
        *_reliability(drives, asked),
    ]
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{html.escape(title)}</title><style>{STYLE}{TABLE}</style>'
    return head + "\n".join(body) + "</html>\n"


def joined(drives: Sequence[DriveWorth], model: str) -> Answers:
    """Of all drives; stretches are the drives' own."""
    parts, first = [], 0
    for drive in drives:
        one = drive.by_model[model].answers
        shifted = {name: getattr(one, name) for name in one.__dataclass_fields__} | {"stretch": one.stretch + first}
        parts.append(Answers(**shifted))
        first += int(one.stretch.max(initial=-1)) + 1
    return Answers.joined(parts)


def sentences(drives: Sequence[DriveWorth], asked: Mapping[str, Answers]) -> list[str]:
    """What a reader in a hurry has to know."""
    way, ours = sum(drive.way for drive in drives), live(asked[OURS])
    said = [
        f"Of 100 reflections that the map was not shown, {_hundred(ours.found)} lay within one cell of one that it already "
        f"called occupied, {_hundred(ours.called_free)} in a cell that it called free, {_hundred(ours.unknown)} where it knew nothing."
    ]
    if ANALYTIC in asked:
        plain = live(asked[ANALYTIC])
        said.append(f"The plain geometric model: {_hundred(plain.found)}, {_hundred(plain.called_free)} and {_hundred(plain.unknown)}.")
    swept = max(drive.by_model[OURS].swept for drive in drives)
    said.append(
        f"Of the ground that the car itself drove over, the map calls {swept:.2%} occupied in the worst drive; it should be nothing."
    )
    lost = [drive.name for drive in drives if drive.maps > 1]
    if lost:
        said.append(f"A new map was begun in {', '.join(lost)}: finished maps are of what came after.")
    if way < 1000:
        said.append(f"All of it rests on {way:.0f} m of way: intervals are wide, and other streets may differ.")
    return said


def _opening(drives: Sequence[DriveWorth], asked: Mapping[str, Answers]) -> str:
    way, seconds = sum(drive.way for drive in drives), sum(drive.seconds for drive in drives)
    lines = "".join(f"<p>{html.escape(one)}</p>" for one in sentences(drives, asked))
    ours, count = live(asked[OURS]), "1 drive" if len(drives) == 1 else f"{len(drives)} drives"
    return f"""<p class="big">{ours.found.value:.0%} found, {ours.called_free.value:.1%} called free</p>{lines}
<p class="rests">{count}, {way:.0f} m, {seconds:.0f} s. Model: {html.escape(drives[0].model)}. There is no truth here: half of
the scans made the map, the other half judged it. What no radar ever detected is not in these figures; what one detected wrongly, such
as mirror images, is. Occupied is p ≥ {OCCUPIED:g}, free p ≤ {FREE:g}, as published. Intervals in brackets: the middle 95 % of draws of
{STRETCH:g} m stretches.</p>"""


def _drives(drives: Sequence[DriveWorth]) -> list[str]:
    rows = []
    for drive in drives:
        for model, one in drive.by_model.items():
            rows.append(
                (
                    drive.name,
                    model,
                    f"{drive.way:.0f} m",
                    f"{one.recall:.3f}",
                    f"{one.false_free:.2%}",
                    f"{one.swept:.3%}",
                    f"{one.observed_m2:.0f} m²",
                    f"{one.occupied_m2:.0f} m²",
                    f"{one.free_m2:.0f} m²",
                )
            )
    head = ("drive", "model", "way", "found", "called free", "swept ground occupied", "known", "occupied", "free")
    return ["<h2>The finished map of every other scan, by drive</h2>", table(head, rows)]


def _parts(drives: Sequence[DriveWorth], asked: Answers) -> list[str]:
    out = ["<h2>When a scan came: by radar, distance and age of what the map said</h2>"]
    groups = [("radar", by_radar(asked, drives[0].radars))] if len({drive.radars for drive in drives}) == 1 else []
    groups += [("distance", by_range(asked)), ("the cell was last in view", by_age(asked))]
    for title, parts in groups:
        out.append(
            table((title, "reflections", "found", "called free", "nothing known"), [_row(name, live(part)) for name, part in parts.items()])
        )
    return out


def _row(name: str, one: Live) -> tuple[str, ...]:
    return name, str(one.detections), *(_share(part) for part in (one.found, one.called_free, one.unknown))


def _reliability(drives: Sequence[DriveWorth], asked: Mapping[str, Answers]) -> list[str]:
    """What was stated beside what was so."""
    even = Curve("even", np.array((0.0, 1.0)), np.array((0.0, 1.0)), line=True)
    cells = [
        Curve(model, *points(np.sum([drive.by_model[model].cells for drive in drives], axis=0)), line=True) for model in drives[0].by_model
    ]
    out = [
        "<h2>Is p what it says? Cells of the finished map, judged by hindsight</h2>",
        "<p>Occupied: several looks that the map was not shown agree. Free: several passed and none ended near, or the car drove there. "
        "The rest, all that is near a reflection among it, is not judged, so the middle of the scale holds few cells and mostly occupied "
        "ones.</p>",
        plot([even, *cells], "stated p", "occupied"),
        "<h2>Rays that ended among those that ended or passed, by stated p</h2>",
        "<p>Most looks at a thing return nothing, so these curves lie below what is occupied; they should rise, and alike.</p>",
    ]
    ours = asked[OURS]
    groups = [by_radar(ours, drives[0].radars)] if len({drive.radars for drive in drives}) == 1 else []
    for parts in (*groups, by_range(ours), by_age(ours)):
        out.append(plot([Curve(name, *points(diagram(part)), line=True) for name, part in parts.items()], "stated p", "share"))
    return out


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def line(tag: str, cells: Sequence[str]) -> str:
        return f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>"

    return "\n".join(("<table>", line("th", head), *(line("td", row) for row in rows), "</table>"))


def _hundred(one: Share) -> str:
    return "–" if math.isnan(one.value) else f"{100 * one.value:.0f}" if one.value >= 0.1 else f"{100 * one.value:.1f}"


def _share(one: Share) -> str:
    return "–" if math.isnan(one.value) else f"{one.value:.1%} [{one.low:.1%}, {one.high:.1%}]"
