"""The command `echogrid-train reproduce`: the paper's four autoencoders, its table and its figures on simulated drives, as one HTML page.

PyTorch is imported when it runs, not before.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from echogrid.errors import EchogridError
from echogrid_training.learning.dataset import find_drives, joined, load_drive, load_drives, split, town
from echogrid_training.learning.fit import add_choices, positive
from echogrid_training.recording import Track, untracked
from echogrid_training.truth.simulated_truth import load_simulated_truth

PAGE, FIGURES = "reproduction.html", "reproduction.json"
TURNS = 150_000_000  # ns: turns of the lidar that are farther apart are not of the radars' time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("--drives", type=Path, required=True, metavar="DIR", help="simulated drives to learn from; one town in 8 validates")
    parser.add_argument("--test", type=Path, required=True, metavar="DIR", help="simulated drives of other towns: for table and figures")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=f"for {PAGE}, its pictures, and a folder for each network")
    parser.add_argument("--epochs", type=positive, metavar="N", help="of each network (default: 30, or 4 short ones with --small)")
    add_choices(parser, "loss")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of first weights, order and augmentation (default: 0)")
    parser.add_argument("--seeds", type=positive, default=1, metavar="N", help="networks of each kind, from --seed on (default: 1)")
    parser.add_argument("--small", action="store_true", help="few samples, networks half as wide: five minutes each on two cores")
    parser.add_argument("--workers", type=positive, default=os.cpu_count() or 1, metavar="N", help="processes that cut samples")
    parser.add_argument("--resume", action="store_true", help="continue the runs in --out where they were interrupted")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Trains, judges, maps, draws and writes; returns the table in Markdown. Raises EchogridError."""
    from echogrid_training.learning import train
    from echogrid_training.paper import autoencoders, reproduction, reproduction_report, table_one

    learned, held_out = split(find_drives(options.drives))
    tested = find_drives(options.test)
    check_apart([*learned, *held_out], tested, options.test)
    check_turns([*learned, *held_out, *tested])
    samples, validation, test = (load_drives(of, track, whole=True, workers=options.workers) for of in (learned, held_out, tested))
    parts = {
        "learned from": reproduction_report.Part(learned, len(samples), samples.digest()),
        "validation": reproduction_report.Part(held_out, len(validation), validation.digest()),
        "test": reproduction_report.Part(tested, len(test), test.digest()),
    }
    plain = (train.small if options.small else train.Settings)("paper", "independent", seed=options.seed)
    chosen: dict[str, Any] = {} if options.epochs is None else {"epochs": options.epochs}
    chosen |= {"labels": options.labels, "l2": options.l2}
    settings = [replace(plain, seed=options.seed + number, **chosen) for number in range(options.seeds)]
    towns = [joined([load_drive(drive, whole=True) for drive in drives]) for drives in by_town(tested).values()]
    networks = autoencoders.reproduce(samples, validation, towns, settings, options.out, resume=options.resume, track=track)
    made = reproduction.reproduction(networks, parts, track)
    for name, png in made.pictures.items():
        (options.out / f"{name}.png").write_bytes(png)
    (options.out / PAGE).write_text(reproduction_report.page(made), "utf-8")
    (options.out / FIGURES).write_text(json.dumps(reproduction_report.figures(made), indent=1) + "\n", "utf-8")
    return f"{options.out / PAGE}\n\n{table_one.markdown(made.table)}"


def by_town(drives: Sequence[Path]) -> dict[str, list[Path]]:
    """Drives through the same town together."""
    towns: dict[str, list[Path]] = {}
    for drive in drives:
        towns.setdefault(town(drive), []).append(drive)
    return towns


def check_apart(learned: Sequence[Path], tested: Sequence[Path], folder: Path) -> None:
    """Raises EchogridError where a drive is on both sides."""
    both = {drive.resolve() for drive in learned} & {drive.resolve() for drive in tested}
    if both:
        raise EchogridError(f"{folder}: --test holds {min(both).name}, which is among --drives as well, expected towns of its own")


def check_turns(drives: Sequence[Path]) -> None:
    """Raises EchogridError where the lidar's image would be of another time than the radars'."""
    for drive in drives:
        apart = int(np.diff(load_simulated_truth(drive / "truth.npz").lidar.stamp_ns).max(initial=0))
        if apart > TURNS:
            raise EchogridError(
                f"{drive / 'truth.npz'}: turns of the lidar {apart * 1e-9:.2f} s apart found, expected at most {TURNS * 1e-9:.2f} s: "
                "the drive is of an older simulator, make it anew"
            )
