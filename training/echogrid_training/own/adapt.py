"""`echogrid-train adapt`: a model for this car, out of drives that nobody labelled.

Written is what costs least on stretches that it was not fitted to: the model with its weights and its last step adapted, with its last step
alone, or as it was where neither is surely better without finding less.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnx

from echogrid.config.loading import load_config
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.look_map import Calibration
from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid.files import check_file
from echogrid.logs.drive import find_drive
from echogrid.model.choice import SHIPPED, shipped
from echogrid.model.network import KEY, OnnxSensorModel
from echogrid_training.evaluation.real import finite, named
from echogrid_training.evaluation.recorded.drive import RealDrive
from echogrid_training.learning.fit import positive
from echogrid_training.own import fine_tuning
from echogrid_training.own.calibrating import Scores, counts, crossed, fitted, least_found, scores, surely_better
from echogrid_training.own.half import driven_through, roomy
from echogrid_training.own.measure import every_other, heard
from echogrid_training.own.patches import FOLDS, Patch, patches
from echogrid_training.recording import Track, untracked

SURE = 0.9  # of the draws of stretches in which what is written has to cost less than the model as it was
WORTH = 0.1  # share of the cost that the last step alone has to save: a twentieth on its own streets was a loss on others (training/LOG.md)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument(
        "model", type=named, metavar="MODEL", help="to begin with: default, or the path of an .onnx file with fusion 'looks'"
    )
    parser.add_argument("drives", type=Path, nargs="+", metavar="DRIVE", help="drive folders, or recordings with -c")
    parser.add_argument("-c", "--config", type=Path, metavar="FILE", help="configuration of the recordings")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.onnx", help="the model to write")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--calibrate-only", action="store_true", help="fit how the network is read out, two numbers, and not its weights")
    what.add_argument("--simulated", type=Path, metavar="DIR", help="towns that the weights go on learning from, of simulate --like DRIVE…")
    parser.add_argument("--epochs", type=positive, default=fine_tuning.EPOCHS, metavar="N", help=f"at most (default: {fine_tuning.EPOCHS})")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the samples' order (default: 0)")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Writes the model; returns its figures before and after on stretches that it never saw, as Markdown. Raises EchogridError."""
    check_out(options.out)
    path = shipped(options.model)[0] if options.model in SHIPPED else Path(options.model)  # not what is fast here: the same everywhere
    parent = OnnxSensorModel(path, GridSpec(), {})
    if parent.contract.fusion != "looks":
        raise EchogridError(f"{parent.path}: is meant for fusion = '{parent.contract.fusion}', expected 'looks'")
    towns = None if options.simulated is None else fine_tuning.of_towns(options.simulated, track)
    drives = [heard(source, options.config)[0] for source in track(options.drives, "reading drives")]
    parts = enough(halves(drives, parent.path, track), options.drives)
    start = parent.contract.calibration
    notes = {"parent": {"file": parent.path.name, "sha256": parent.sha256}, "drives": hashes(options.drives, options.config)}
    with tempfile.TemporaryDirectory() as temporary:
        before = np.stack([counts(one, start) for one in parts])
        tried = [
            Tried("the model as it was", [parent.path], start, before),
            read_anew("the last step fitted", [parent.path], parts, start, WORTH),
        ]
        if towns is not None:
            base = shipped(options.model)[-1] if options.model in SHIPPED else parent.path
            files = fine_tuning.tuned(base, *towns, Path(temporary), start, seed=options.seed, epochs=options.epochs, track=track)
            parts = enough(halves(drives, files[-1], track), options.drives)
            tried.append(read_anew("weights and last step adapted", files, parts, start))
        best = chosen(tried)
        figures = {"before": finite(asdict(tried[0].scores)), "after": finite(asdict(best.scores))}
        outs = [options.out, options.out.with_suffix(".int8.onnx")][: len(best.files)]
        for file, out in zip(best.files, outs, strict=True):
            write(file, out, best.calibration, notes | figures)
    said = f"learned = {best.calibration.learned:g}, offset = {best.calibration.offset:g} (before {start.learned:g}, {start.offset:g})"
    return "\n".join((f"{', '.join(map(str, outs))}: {best.what}; {said}", "", *table(tried)))


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """One way to adapt: its files, float before int8 where there are two, and what stretches say of it that it was not fitted to."""

    what: str
    files: list[Path]
    calibration: Calibration
    counts: Floats  # (S, 8) by stretch
    worth: float = 0.0  # share of the cost that it has to save

    @property
    def scores(self) -> Scores:
        return scores(self.counts.sum(axis=0))

    def better(self, than: Tried) -> float:
        """Share of draws of stretches in which it costs less."""
        return surely_better(than.counts, self.counts)


def read_anew(what: str, files: list[Path], parts: Sequence[Patch], start: Calibration, worth: float = 0.0) -> Tried:
    """With the last step fitted: to all stretches in the file, to the other folds in the figures of each stretch."""
    return Tried(what, files, fitted(Patch.joined(parts), start), crossed(parts, start), worth)


def chosen(tried: Sequence[Tried]) -> Tried:
    """What costs least of that which is surely better than the first, by as much as it has to be, and finds what the first does, within its
    interval; the first where nothing is."""
    first, *others = tried
    least = least_found(first.counts)
    harmless = [one for one in others if one.scores.found >= least]
    worth = [one for one in harmless if one.scores.cost <= (1 - one.worth) * first.scores.cost and one.better(first) >= SURE]
    return min(worth, key=lambda one: one.scores.cost, default=first)


def check_out(path: Path) -> None:
    """Raises EchogridError unless a model may be written there."""
    if path.suffix != ".onnx":
        raise EchogridError(f"--out {path}: expected a name that ends in .onnx")
    check_file(path)


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


def enough(parts: Sequence[Patch], sources: Sequence[Path]) -> list[Patch]:
    """Those of which hindsight says something. Raises EchogridError unless some are of each fold."""
    known = [one for one in parts if len(one.chance)]
    if {one.fold for one in known} != set(range(FOLDS)):
        names = ", ".join(str(source) for source in sources[:3])
        raise EchogridError(
            f"{names}: too short to fit to one part and score on another; expected 150 m and more between things that radars see"
        )
    return known


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


def table(tried: Sequence[Tried]) -> list[str]:
    """Rows of Markdown: the model as it was, then what was tried."""
    scores = [one.scores for one in tried]
    heads = ("before", "last step", "weights and last step")[: len(tried)]
    rows = [f"| on stretches that were not fitted to | {' | '.join(heads)} |", "| --- |" + " --- |" * len(tried)]
    rows.append(f"| reflections not shown | {' | '.join(str(one.detections) for one in scores)} |")
    for name, title in {
        "found": "found",
        "called_free": "called free",
        "free_called_free": "free cells called free",
        "free_called_occupied": "free cells called occupied",
    }.items():
        rows.append(f"| {title} | {' | '.join(f'{getattr(one, name):.2%}' for one in scores)} |")
    rows.append(f"| cost of what is decided | {' | '.join(f'{one.cost:.4f}' for one in scores)} |")
    rows.append(f"| found, at least, to be written | {least_found(tried[0].counts):.2%} |{' |' * len(tried[1:])}")
    sure = " | ".join(f"{one.better(tried[0]):.0%}" for one in tried[1:])
    rows.append(f"| draws of stretches in which it costs less | | {sure} |")
    rows.append(f"| NLL, cells | {' | '.join(f'{one.nll:.4f}, {one.cells}' for one in scores)} |")
    return rows
