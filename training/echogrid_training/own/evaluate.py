"""`echogrid-train evaluate own`: what the running model is worth on this car, without any truth."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from echogrid.files import check_file
from echogrid_training.evaluation.real import finite, named
from echogrid_training.own.measure import DriveWorth, heard, measure
from echogrid_training.own.page import joined, page_of, sentences
from echogrid_training.own.worth import by_age, by_radar, by_range, live
from echogrid_training.recording import Track, untracked


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("drives", type=Path, nargs="+", metavar="DRIVE", help="drive folders, or recordings with -c")
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", help="configuration of the recordings")
    parser.add_argument("--model", type=named, help="default, paper or an .onnx file in place of the configuration's own")
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="one page with everything, for people")
    parser.add_argument("--json", type=Path, metavar="FILE.json", help="for all figures")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Writes the page and the figures; returns the page's first sentences. Raises EchogridError."""
    for path, suffix in ((options.report, ".html"), (options.json, ".json")):
        if path is not None:
            check_file(path, suffix)
    found = [measure(title(source), heard(source, options.config)[0], options.model) for source in track(options.drives, "judging drives")]
    if options.report is not None:
        options.report.write_text(page_of(found, "What the map is worth on this car"), encoding="utf-8")
    if options.json is not None:
        options.json.write_text(json.dumps(finite(figures(found)), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return "\n".join(sentences(found, {model: joined(found, model) for model in found[0].by_model}))


def title(source: Path) -> str:
    """A drive's name on the page."""
    return source.absolute().name


def figures(drives: Sequence[DriveWorth]) -> dict[str, Any]:
    """All of them, of every drive and pooled, as JSON takes them."""
    pooled: dict[str, Any] = {}
    for model in drives[0].by_model:
        asked = joined(drives, model)
        groups = {"range": by_range(asked), "age": by_age(asked)}
        if len({drive.radars for drive in drives}) == 1:
            groups["radar"] = by_radar(asked, drives[0].radars)
        pooled[model] = asdict(live(asked)) | {
            name: {part: asdict(live(one)) for part, one in parts.items()} for name, parts in groups.items()
        }
    one_by_one = [
        {"name": drive.name, "way_m": drive.way, "seconds": drive.seconds, "maps": drive.maps}
        | {
            model: asdict(live(one.answers))
            | {name: getattr(one, name) for name in ("recall", "false_free", "left_out", "observed_m2", "occupied_m2", "free_m2", "swept")}
            | {"reliability": one.cells.tolist()}
            for model, one in drive.by_model.items()
        }
        for drive in drives
    ]
    return {"model": drives[0].model, "drives": one_by_one, "pooled": pooled}
