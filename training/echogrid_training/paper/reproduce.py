"""The command `echogrid-train reproduce`: the paper's four autoencoders, its table and its figures on simulated drives, as one HTML page.

PyTorch is imported when it runs, not before.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from echogrid.errors import EchogridError
from echogrid_training.learning.dataset import find_drives, load_drives, split
from echogrid_training.learning.fit import positive
from echogrid_training.recording import Track, untracked

PAGE = "reproduction.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("--drives", type=Path, required=True, metavar="DIR", help="simulated drives to learn from; one town in 8 validates")
    parser.add_argument("--test", type=Path, required=True, metavar="DIR", help="simulated drives of other towns: for table and figures")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=f"for {PAGE}, its pictures, and a folder for each network")
    parser.add_argument("--epochs", type=positive, metavar="N", help="of each network (default: 30, or 4 short ones with --small)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of first weights, order and augmentation (default: 0)")
    parser.add_argument("--small", action="store_true", help="few samples, networks half as wide: five minutes each on two cores")
    parser.add_argument("--workers", type=positive, default=os.cpu_count() or 1, metavar="N", help="processes that cut samples")
    parser.add_argument("--resume", action="store_true", help="continue the runs in --out where they were interrupted")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Trains, judges, maps, draws and writes; returns the table in Markdown. Raises EchogridError."""
    from echogrid_training.learning import train
    from echogrid_training.paper import autoencoders, reproduction, reproduction_report

    learned, held_out = split(find_drives(options.drives))
    tested = find_drives(options.test)
    _check_apart([*learned, *held_out], tested, options.test)
    drives = {"learned from": learned, "validation": held_out, "test": tested}
    parts = {
        name: reproduction_report.Part(of, load_drives(of, track, disturbed=of is not tested, workers=options.workers))
        for name, of in drives.items()
    }
    chosen = {} if options.epochs is None else {"epochs": options.epochs}
    settings = (train.small if options.small else train.Settings)("paper", "independent", seed=options.seed, **chosen)
    samples, validation, test = (part.samples for part in parts.values())
    networks = autoencoders.reproduce(samples, validation, test, settings, options.out, resume=options.resume, track=track)
    made = reproduction.reproduction(networks, parts, track)
    for name, png in made.pictures.items():
        (options.out / f"{name}.png").write_bytes(png)
    (options.out / PAGE).write_text(reproduction_report.page(made), "utf-8")
    return f"{options.out / PAGE}\n\n{reproduction_report.markdown(networks)}"


def _check_apart(learned: Sequence[Path], tested: Sequence[Path], folder: Path) -> None:
    both = {drive.resolve() for drive in learned} & {drive.resolve() for drive in tested}
    if both:
        raise EchogridError(f"{folder}: --test holds {min(both).name}, which is among --drives as well, expected towns of its own")
