"""The command `echogrid-train fit`: drives in, a trained network and its ONNX files out. PyTorch is imported when it runs, not before."""

from __future__ import annotations

import argparse
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from echogrid.arguments import between
from echogrid.core.evidence.history_raster import Bytes
from echogrid.core.map.look_map import Calibration
from echogrid.errors import EchogridError
from echogrid.files import check_folder
from echogrid_training.learning.dataset import Samples, find_drives, joined, load_drives, read_samples, split
from echogrid_training.learning.map_calibration import calibrate_map
from echogrid_training.recording import Track, untracked

QUANTISED_BY = 300  # held-out images
MAPPED = 8  # held-out drives that the map is calibrated on


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("--drives", type=Path, required=True, metavar="DIR", help="simulated drives to learn from; one town in 8 validates")
    parser.add_argument(
        "--samples",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE.npz",
        help="more samples to learn from, made elsewhere (docs/simulator.md)",
    )
    parser.add_argument("--test", type=Path, metavar="DIR", help="simulated drives of other towns, to report errors on")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="for log, checkpoint and ONNX files")
    parser.add_argument("--network", choices=("default", "paper"), default="default", help="(default: default)")
    parser.add_argument(
        "--weighting",
        choices=("independent", "inverse"),
        default="independent",
        help="of classes in the paper's loss (default: independent)",
    )
    add_choices(parser, "decay")
    parser.add_argument("--epochs", type=positive, metavar="N", help="(default: 30, or 4 short ones with --small)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of first weights, order and augmentation (default: 0)")
    parser.add_argument("--from", dest="start", type=Path, metavar="FILE", help="a float ONNX file of the default network to go on from")
    parser.add_argument(
        "--keep", type=_share, default=0.5, metavar="K", help="share of that file's weights in what is written (default: 0.5)"
    )
    parser.add_argument("--small", action="store_true", help="few samples, the paper's network half as wide: five minutes on two cores")
    parser.add_argument("--workers", type=positive, default=os.cpu_count() or 1, metavar="N", help="processes that cut samples")
    parser.add_argument("--resume", action="store_true", help="continue the run in --out where it was interrupted")


def add_choices(parser: argparse.ArgumentParser, l2: str) -> None:
    """What the paper's loss leaves open."""
    parser.add_argument(
        "--labels",
        choices=("ternary", "soft"),
        default="ternary",
        help="that the paper's loss compares with: -1, 0 and 1, or tanh(L / 2) of the true log-odds L (default: ternary)",
    )
    parser.add_argument(
        "--l2",
        choices=("decay", "loss"),
        default=l2,
        help=f"AdamW's decay of convolutions, or the squares of all weights in the loss, as the paper has it (default: {l2})",
    )


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Trains, judges, exports; returns the figures as a table in Markdown. Raises EchogridError."""
    check_folder(options.out)
    from echogrid_training.learning import export, judging, train, warm_start

    if options.start is not None and options.network != "default":
        raise EchogridError(f"--from {options.start}: is for the default network, found --network {options.network}")
    train.check_new(options.out, resume=options.resume)
    learned, held_out = split(find_drives(options.drives))
    tested = [] if options.test is None else find_drives(options.test)
    others = [read_samples(path) for path in options.samples]
    samples, validation = (load_drives(drives, track, disturbed=True, workers=options.workers) for drives in (learned, held_out))
    samples = joined([samples, *others])
    chosen: dict[str, Any] = {} if options.epochs is None else {"epochs": options.epochs}
    chosen |= {"labels": options.labels, "l2": options.l2}
    if options.start is not None:
        chosen["rate"] = warm_start.RATE
    settings = replace((train.small if options.small else train.Settings)(options.network, options.weighting, seed=options.seed), **chosen)
    start = None if options.start is None else warm_start.started(options.start, samples)
    trained = train.fit(samples, validation, settings, options.out, resume=options.resume, track=track, start=start)
    if int(os.environ.get("RANK", "0")):
        return "the first process judges and exports"
    calibration = Calibration(*trained.calibration)
    if options.start is not None:
        learned_file = export.export(trained, options.out / "learned", calibration)[0]
        trained = replace(trained, weights=warm_start.between(options.start, learned_file, options.keep, validation))
    way, model = trained.recipe(), trained.model()
    rows = [_row("validation", len(held_out), len(validation), judging.judge(way, model, validation))]
    if tested:
        test = load_drives(tested, track, workers=options.workers)
        rows.append(_row("test", len(tested), len(test), judging.judge(way, model, test)))
    paths = export.export(trained, options.out, calibration, calibrating(validation) if options.network == "default" else None)
    if options.network == "default":
        calibration = calibrate_map(some(held_out, MAPPED), paths[0], track)
        paths = export.export(trained, options.out, calibration, calibrating(validation))
    head = f"{', '.join(str(path) for path in paths)}: learned from {len(samples)} samples of {len(learned)} drives"
    return "\n".join((head, "", *TABLE, *rows))


def calibrating(samples: Samples) -> Bytes:
    """Images (N, 12, 128, 128) that span the samples, for the steps of int8."""
    images: Bytes = samples.images[np.linspace(0, len(samples) - 1, min(len(samples), QUANTISED_BY)).astype(int)]
    return images


def some(drives: list[Path], count: int) -> list[Path]:
    """At most `count`, evenly spread."""
    return [drives[index] for index in sorted(set(np.linspace(0, len(drives) - 1, min(len(drives), count)).astype(int).tolist()))]


TABLE = (
    "| drives | samples | MSE free | unknown | occupied | soft labels: free | unknown | occupied |",
    "| --- | --- | --- | --- | --- | --- | --- | --- |",
)


def _row(name: str, drives: int, samples: int, figures: dict[str, dict[str, float]]) -> str:
    values = [value for kind in ("ternary", "soft") for value in figures[kind].values()]
    return f"| {name}: {drives} | {samples} | " + " | ".join("–" if math.isnan(value) else f"{value:.3f}" for value in values) + " |"


def _share(text: str) -> float:
    return between(text, 0, 1, "found, expected a share")


def positive(text: str) -> int:
    """An argument that counts something."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' found, expected a whole number from 1 on")
    return int(text)
