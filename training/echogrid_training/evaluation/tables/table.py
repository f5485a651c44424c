"""The results as tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from echogrid_training.evaluation.simulated.patches import RINGS, STRATA
from echogrid_training.evaluation.simulated.probes import LOOKS, STANDING
from echogrid_training.evaluation.simulated.results import REFERENCE
from echogrid_training.evaluation.tables.markdown import markdown

Row = dict[str, Any]
COLUMNS = {  # of figures: heading by name
    "ap": "AP",
    "iou": "IoU",
    "f1": "F 1 cell",
    "f2": "F 2 cells",
    "nll": "NLL",
    "brier": "Brier",
    "ece": "ECE",
    "unsafe": "P(occ \\| p < 0.1)",
}
CLASS_MSE = {
    "mse_free": "MSE free",
    "mse_unknown": "unknown",
    "mse_occupied": "occupied",
    "soft_mse_free": "soft: free",
    "soft_mse_unknown": "unknown",
    "soft_mse_occupied": "occupied",
}
PUBLISHED = {
    "said": "share of cells known",
    "published_nll": "NLL as published",
    "published_ece": "ECE as published",
    "sure": "beyond ±3.5",
    "sure_and_wrong": "wrong of these",
}
MAPS = {"around": "The map around the car, every 5 m of way", "finished": "The finished map, at the same places"}


def tables(results: Row) -> str:
    """All of them, one after the other."""
    levels = results["levels"]
    head = (
        f"{results['drives']} test drives through {results['towns']} towns, {results['patches']} patches; parameters, readings and "
        f"thresholds from {results['calibration_drives']} drives through other towns. "
        "± is the deviation over seeds; [ ] the middle 95 in 100 of resampled towns."
    )
    parts = [("", head)]
    if "patch" in levels:
        parts.append(("Single map updates", _figures(levels["patch"], COLUMNS)))
        parts.append(("Class errors of single map updates", _figures(levels["patch"], CLASS_MSE)))
        parts.append((f"AP and NLL by distance: {len(RINGS)} rings", _strata(levels["patch"], STRATA[: len(RINGS)])))
        parts.append(("AP and NLL by visibility", _strata(levels["patch"], STRATA[len(RINGS) :])))
    for level, title in MAPS.items():
        parts.append((title, _figures(levels[level], COLUMNS)))
        parts.append((f"{title}: as published", _figures(_published(levels[level]), PUBLISHED)))
        parts.append((f"{title}: class errors as published", _figures(_published(levels[level]), CLASS_MSE)))
    parts.append((f"Against {REFERENCE['patch']} and {REFERENCE['around']}: intervals of the difference", _differences(levels)))
    if "patch" in levels:
        parts.append(("IoU after a cold start, by looks of 0.5 m", _cold(levels)))
        parts.append(("Standing, and the same way twice", _probes(results)))
    parts += [(f"Sweep: {name}", _sweep(points)) for name, points in results.get("sweep", {}).items()]
    parts.append(("As tuned", "\n".join(f"- {name}: `{method}`" for name, method in results["tuned"].items())))
    return "\n\n".join(f"### {title}\n\n{body}" if title else body for title, body in parts if body) + "\n"


def number(value: float | None) -> str:
    """Three digits, a dash for what has no meaning."""
    return "–" if value is None else f"{value:.3f}"


def _with(row: Row, name: str) -> str:
    text = number(row[name])
    if "sd" in row and row["sd"][name] is not None:
        text += f" ± {row['sd'][name]:.3f}"
    if name in row["interval"]:
        low, high = row["interval"][name]
        text += f" [{number(low)}, {number(high)}]"
    return text


def _figures(rows: dict[str, Row], columns: dict[str, str]) -> str:
    kept = {name: row for name, row in rows.items() if any(row[column] is not None for column in columns)}
    return markdown(("method", *columns.values()), [(name, *(_with(row, column) for column in columns)) for name, row in kept.items()])


def _published(rows: dict[str, Row]) -> dict[str, Row]:
    """What the service can publish, by one configuration or another: not the layers of a map alone."""
    return {name: row for name, row in rows.items() if "layer" not in name}


def _strata(rows: dict[str, Row], strata: Sequence[str]) -> str:
    first = next(iter(rows.values()))["strata"]
    shares = [f"{name} ({first[name]['cells'] or 0:.0%}, {first[name]['occupied'] or 0:.1%} occupied)" for name in strata]

    def cell(row: Row, name: str) -> str:
        return f"{number(row['strata'][name]['ap'])} / {number(row['strata'][name]['nll'])}"

    return markdown(("method", *shares), [(name, *(cell(row, stratum) for stratum in strata)) for name, row in rows.items()])


def _differences(levels: dict[str, dict[str, Row]]) -> str:
    columns = (("patch", "ap"), ("patch", "nll"), ("around", "iou"), ("finished", "iou"))
    heads = ("method", *(f"{COLUMNS[figure]}, {level}" for level, figure in columns))
    names = list(dict.fromkeys(name for level in REFERENCE for name in levels.get(level, {})))
    rows = []
    for name in names:
        cells = []
        for level, figure in columns:
            row = levels.get(level, {}).get(name)
            cells.append("–" if row is None else "{:+.3f} … {:+.3f}".format(*row["over_reference"][figure]))
        rows.append((name, *cells))
    return markdown(heads, rows)


def _cold(levels: dict[str, dict[str, Row]]) -> str:
    found = [(f"{looks}", levels[f"after {looks} looks"]) for looks in LOOKS if f"after {looks} looks" in levels]
    found.append(("all", levels["around"]))
    return markdown(
        ("method", *(head for head, _ in found)), [(name, *(number(rows[name]["iou"]) for _, rows in found)) for name in levels["around"]]
    )


def _probes(results: Row) -> str:
    rows = []
    for name, twice in results["revisit"].items():
        change = None if None in twice.values() else twice["second"] - twice["first"]
        stood = results["standstill"].get(name)
        rows.append((name, number(stood), number(twice["first"]), number(twice["second"]), "–" if change is None else f"{change:+.3f}"))
    heads = ("method", f"largest change of p in {STANDING} s of standing", "IoU, driven once", "IoU, twice", "change")
    return markdown(heads, rows)


def _sweep(points: dict[str, dict[str, Row]]) -> str:
    """`points`: by what was varied, then by figure, then by method."""
    first = next(iter(points.values()))
    heads = ("", *(f"{figure}, {name}" for figure, methods in first.items() for name in methods))
    return markdown(
        heads, [(point, *(number(value) for methods in row.values() for value in methods.values())) for point, row in points.items()]
    )
