"""`echogrid-train evaluate real`: learned and analytic side by side on recordings that were not made for it.

Every recording goes through the whole chain: imported into CAN frames, decoded, mapped by the service with dead-reckoned poses, the network
run from its file. What is scored: recorded/scores.py on drives, recorded/astyx.py on single frames beside a lidar.
"""

from __future__ import annotations

import argparse
import difflib
import json
import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from echogrid.core.evidence.raster import GridSpec
from echogrid.files import check_file, check_folder
from echogrid.model.choice import SHIPPED, choose
from echogrid_training.drives import nuscenes, radarscenes
from echogrid_training.drives.drive import write_drive
from echogrid_training.evaluation.recorded import astyx as real_astyx
from echogrid_training.evaluation.recorded import picture as real_picture
from echogrid_training.evaluation.recorded.annotated import load_annotated
from echogrid_training.evaluation.recorded.comparison import DriveScores, compare, summaries
from echogrid_training.evaluation.recorded.drive import hear
from echogrid_training.evaluation.recorded.tables import annotated_tables, drive_tables, frame_table
from echogrid_training.recording import Recording, Track, untracked

Load = Callable[[], Recording]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("kind", choices=("nuscenes", "radarscenes", "astyx"))
    parser.add_argument("sources", type=Path, nargs="+", metavar="SOURCE", help="what `import` takes, or .npz of Astyx")
    parser.add_argument("--scene", action="append", metavar="NAME", help="of nuScenes, where SOURCE holds several; may be repeated")
    parser.add_argument("--model", type=named, default="default", help="default, paper, or the path of an .onnx file (default: default)")
    parser.add_argument("--sum", action="store_true", help="of drives also the network's answers summed, the paper's Eq. 1")
    parser.add_argument("--json", type=Path, required=True, metavar="FILE.json", help="for all figures, with areas and thresholds")
    parser.add_argument("--out", type=Path, metavar="DIR", help="for pictures of the maps")
    parser.add_argument("--truth", type=Path, metavar="DIR", help="annotated truth of drives, NAME_truth.npz each, to score the maps by")


def named(text: str) -> str:
    """An argument that names a network."""
    if text not in SHIPPED and not text.endswith(".onnx"):
        near = difflib.get_close_matches(text, SHIPPED, n=1)
        guess = f"; did you mean '{near[0]}'?" if near else ""
        raise argparse.ArgumentTypeError(f"'{text}' found, expected {', '.join(SHIPPED)}, or the path of an .onnx file{guess}")
    return text


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Writes the figures and the pictures; returns tables in Markdown. Raises EchogridError."""
    folders = (options.json.parent, *([options.out] if options.out else []))
    for folder in folders:
        check_folder(folder)
    for folder in folders:
        folder.mkdir(parents=True, exist_ok=True)
    check_file(options.json, ".json")
    choice = choose(options.model, GridSpec(), {})
    network = str(choice.model.path)  # the same file for all, where there are several
    if options.kind == "astyx":
        figures, tables = _frames(options.sources, network, options.out, track)
    else:
        loads = {"nuscenes": _nuscenes, "radarscenes": _radarscenes}[options.kind](options)
        figures, tables = _drives(loads, network, options.out, track, summed=options.sum, truths=options.truth)
    text = json.dumps(finite({"kind": options.kind, "model": choice.why, **figures}), indent=2, allow_nan=False)
    options.json.write_text(text + "\n", encoding="utf-8")
    return tables


def _nuscenes(options: argparse.Namespace) -> list[Load]:
    return [partial(nuscenes.load, source, scene) for source in options.sources for scene in options.scene or [None]]


def _radarscenes(options: argparse.Namespace) -> list[Load]:
    return [partial(radarscenes.load, source) for source in options.sources]


def _drives(
    loads: Sequence[Load], model: str, out: Path | None, track: Track, *, summed: bool, truths: Path | None
) -> tuple[dict[str, Any], str]:
    scores: list[DriveScores] = []
    for load in track(list(loads), "scoring drives"):
        recording = load()
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary) / "drive"
            write_drive(recording, folder)
            first = scores[0] if scores else None
            truth = None if truths is None else load_annotated(truths / f"{recording.vehicle}_truth.npz")
            one, halves = compare(recording.vehicle, hear(folder), model, first, summed=summed, truth=truth)
        scores.append(one)
        if out is not None:
            real_picture.drive_sheet(halves).save(out / f"{recording.vehicle}.png")
    found = summaries(scores)
    figures = {"drives": [asdict(one) for one in scores], "summaries": [asdict(one) for one in found]}
    tables = drive_tables(scores, found)
    return figures, tables if truths is None else f"{annotated_tables(scores)}\n\n{tables}"


def _frames(sources: Sequence[Path], model: str, out: Path | None, track: Track) -> tuple[dict[str, Any], str]:
    scores: list[real_astyx.FrameScores] = []
    for source in sources:
        frames = real_astyx.load(source)
        for place in real_astyx.PLACES:
            judge = real_astyx.Judge(model, place)
            scores.append(real_astyx.score(source.stem, frames, judge, track))
            if out is not None:
                real_picture.frame_sheet(frames, judge).save(out / f"{source.stem}_{place}.png")
    return {"frames": [asdict(one) for one in scores]}, frame_table(scores)


def finite(value: Any) -> Any:
    """The same, with None for numbers that JSON has no word for."""
    if isinstance(value, dict):
        return {key: finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
