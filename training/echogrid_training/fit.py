"""The command `echogrid-train fit`: drives in, a trained network and its ONNX file out. PyTorch is imported when it runs, not before."""

from __future__ import annotations

import argparse
import hashlib
import math
from pathlib import Path

from echogrid_training.dataset import find_drives, joined, load_drives, split
from echogrid_training.recording import Track, untracked


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("--drives", type=Path, required=True, metavar="DIR", help="simulated drives to learn from; one town in 8 validates")
    parser.add_argument("--test", type=Path, metavar="DIR", help="simulated drives of other towns, to report errors on")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="for log.jsonl, checkpoint.pt, model.pt and model.onnx")
    parser.add_argument("--weighting", choices=("independent", "inverse"), default="independent", help="of classes (default: independent)")
    parser.add_argument("--epochs", type=positive, metavar="N", help="(default: 30, or 8 short ones with --small)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of first weights, order and augmentation (default: 0)")
    parser.add_argument("--small", action="store_true", help="half the width and few samples: minutes on two cores")
    parser.add_argument("--resume", action="store_true", help="go on with the run in --out where it was interrupted")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Trains, judges, exports; returns the figures as a table in Markdown. Raises EchogridError."""
    from echogrid_training import export, train

    learned, held_out = split(find_drives(options.drives))
    parts = load_drives(learned, track)
    samples, validation = joined(parts), joined(load_drives(held_out, track))
    data = hashlib.sha256("\n".join(part.digest() for part in parts).encode()).hexdigest()
    chosen = {} if options.epochs is None else {"epochs": options.epochs}
    settings = (train.small if options.small else train.Settings)(options.weighting, seed=options.seed, **chosen)
    trained = train.fit(samples, validation, settings, options.out, resume=options.resume, track=track, data_sha256=data)
    model = trained.model()
    rows = [_row("validation", len(held_out), len(validation), train.judge(model, validation))]
    if options.test is not None:
        tested = find_drives(options.test)
        test = joined(load_drives(tested, track))
        rows.append(_row("test", len(tested), len(test), train.judge(model, test)))
    path = export.export(trained, options.out / "model.onnx")
    a, b = trained.calibration
    head = f"{path}: {options.weighting} class weights, learned from {len(samples)} samples of {len(learned)} drives"
    head += f"; calibration {a:.3f} z {b:+.3f}"
    return "\n".join((head, "", *TABLE, *rows))


TABLE = (
    "| drives | samples | MSE free | unknown | occupied | soft labels: free | unknown | occupied |",
    "| --- | --- | --- | --- | --- | --- | --- | --- |",
)


def _row(name: str, drives: int, samples: int, figures: dict[str, dict[str, float]]) -> str:
    values = [value for kind in ("ternary", "soft") for value in figures[kind].values()]
    return f"| {name}: {drives} | {samples} | " + " | ".join("–" if math.isnan(value) else f"{value:.3f}" for value in values) + " |"


def positive(text: str) -> int:
    """An argument that counts something."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} found, expected at least 1")
    return number
