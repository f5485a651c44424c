"""`echogrid-train adapt`: a model for this car, out of drives that nobody labelled."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec
import onnx

from echogrid.config.loading import load_config
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid.model.choice import choose
from echogrid.model.network import KEY, OnnxSensorModel
from echogrid_training.evaluation.real import finite, named
from echogrid_training.evaluation.recorded.drive import RealDrive
from echogrid_training.own.calibrating import Scores, fitted, score
from echogrid_training.own.half import driven_through, roomy
from echogrid_training.own.measure import every_other, heard
from echogrid_training.own.patches import Patch, patches
from echogrid_training.recording import Track, untracked


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument(
        "model", type=named, metavar="MODEL", help="to begin with: default, or the path of an .onnx file with fusion 'looks'"
    )
    parser.add_argument("drives", type=Path, nargs="+", metavar="DRIVE", help="drive folders, or recordings with -c")
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", help="configuration of the recordings")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.onnx", help="the model to write")
    parser.add_argument("--calibrate-only", action="store_true", help="fit how the network is read out, two numbers, and not its weights")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Writes the model; returns its figures before and after on stretches that it never saw, as Markdown. Raises EchogridError."""
    check_out(options.out)
    parent = choose(options.model, GridSpec(), {}).model
    if parent.contract.fusion != "looks":
        raise EchogridError(f"{parent.path}: is meant for fusion = '{parent.contract.fusion}', expected 'looks'")
    drives = [heard(source, options.config)[0] for source in track(options.drives, "reading drives")]
    parts = halves(drives, parent.path, track)
    start = parent.contract.calibration
    learned, held_out = split(parts, options.drives)
    before, found = score(held_out, start), fitted(learned, start)
    after = score(held_out, found)
    kept = not after.cost < before.cost
    if kept:
        found, after = start, before
    notes = {"parent": {"file": parent.path.name, "sha256": parent.sha256}, "drives": hashes(options.drives, options.config)}
    figures = {"before": finite(asdict(before)), "after": finite(asdict(after))}
    write(parent.path, options.out, found, notes | figures)
    end = "the parent's numbers are kept: others were no better on stretches that were not fitted to" if kept else "fitted by hindsight"
    head = f"{options.out}: learned = {found.learned:g}, offset = {found.offset:g} (before {start.learned:g}, {start.offset:g}); {end}"
    return "\n".join((head, "", *table(before, after)))


def check_out(path: Path) -> None:
    """Raises EchogridError unless a model may be written there."""
    if path.suffix != ".onnx":
        raise EchogridError(f"--out {path}: expected a name that ends in .onnx")
    if not path.absolute().parent.is_dir():
        raise EchogridError(f"--out {path}: there is no folder {path.parent} to write it in")


def halves(drives: Sequence[RealDrive], model: Path, track: Track) -> list[Patch]:
    """Of every drive, mapped once from every other scan."""
    parts: list[Patch] = []
    for drive in track(list(drives), "mapping half of the scans"):
        pipeline = roomy(drive, by_looks(drive, model))
        parts += patches(driven_through(drive, pipeline.mapper, pipeline.model.why, every_other(drive), ask=False))
    return parts


def by_looks(drive: RealDrive, model: Path) -> Any:
    """The drive's configuration with this model, and the map's rule that the model is meant for."""
    config = load_config(drive.config, str(model))
    return msgspec.structs.replace(config, map=msgspec.structs.replace(config.map, fusion="looks"))


def split(parts: Sequence[Patch], sources: Sequence[Path]) -> tuple[Patch, Patch]:
    """What is learned from, and what is scored. Raises EchogridError where either is missing."""
    kinds = [[one for one in parts if one.held_out == scored and len(one.chance)] for scored in (False, True)]
    if not all(kinds):
        names = ", ".join(str(source) for source in sources[:3])
        raise EchogridError(
            f"{names}: too short to learn from one part and score on another; expected 150 m and more between things that radars see"
        )
    learned, held_out = (Patch.joined(kind) for kind in kinds)
    return learned, held_out


def hashes(sources: Sequence[Path], configuration: Path | None) -> list[dict[str, str]]:
    """Name and SHA-256 of each drive: of its configuration and its recording, one after the other."""
    out = []
    for source in sources:
        drive, total = find_drive(source, configuration), hashlib.sha256()
        for path in (drive.config, drive.log):
            with path.open("rb") as file:
                total.update(hashlib.file_digest(file, "sha256").digest())
        out.append({"name": source.absolute().name, "sha256": total.hexdigest()})
    return out


def write(parent: Path, out: Path, calibration: Calibration, notes: dict[str, Any]) -> None:
    """The network of a file, with other numbers in its contract, and notes; it appears once the service takes it. Raises EchogridError."""
    proto = onnx.load(parent)
    held = msgspec.json.decode(next(one.value for one in proto.metadata_props if one.key == KEY))
    held |= {"calibration": {"learned": calibration.learned, "offset": calibration.offset}} | notes
    onnx.helper.set_model_props(proto, {KEY: msgspec.json.encode(held).decode()})
    partial = out.with_name(f".{out.stem}.partial.onnx")
    onnx.save(proto, partial)
    try:
        OnnxSensorModel(partial, GridSpec(), {})
    except EchogridError:
        partial.unlink()
        raise
    partial.replace(out)


def table(before: Scores, after: Scores) -> list[str]:
    """Rows of Markdown."""
    rows = ["| on stretches that were not learned from | before | after |", "| --- | --- | --- |"]
    rows.append(f"| reflections not shown | {before.detections} | {after.detections} |")
    for name, title in {
        "found": "found",
        "called_free": "called free",
        "free_called_free": "free cells called free",
        "free_called_occupied": "free cells called occupied",
    }.items():
        rows.append(f"| {title} | {getattr(before, name):.2%} | {getattr(after, name):.2%} |")
    rows.append(f"| cost of what is decided | {before.cost:.4f} | {after.cost:.4f} |")
    rows.append(f"| NLL of {before.cells} judged cells | {before.nll:.4f} | {after.nll:.4f} |")
    return rows
