"""What the paper's networks learn from and are judged on: simulated drives, as two commands read them."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from echogrid.errors import EchogridError
from echogrid.files import check_folder
from echogrid_training.drives.campaign import PLAN
from echogrid_training.learning.dataset import Samples, find_drives, joined, load_drive, load_drives, split, town
from echogrid_training.learning.fit import positive
from echogrid_training.recording import Track
from echogrid_training.truth.simulated_truth import load_simulated_truth

TURNS = 150_000_000  # ns: turns of the lidar that are farther apart are not of the radars' time


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Drives of one kind, how many samples they give, the sha256 of these, and the plans of the campaigns that they are of."""

    drives: list[Path]
    samples: int
    sha256: str
    plans: list[str]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """Undisturbed samples with the whole true patch as their label."""

    learned: Samples
    held_out: Samples
    towns: list[Samples]  # of each test town
    parts: dict[str, Part]  # 'learned from', 'validation' and 'test'


def add_drives(parser: argparse.ArgumentParser, out: str) -> None:
    """Which drives, how many networks and how long; `out`: what its folder is for."""
    parser.add_argument("--drives", type=Path, required=True, metavar="DIR", help="simulated drives to learn from; one town in 8 validates")
    parser.add_argument("--test", type=Path, required=True, metavar="DIR", help="simulated drives of other towns, to judge by")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=out)
    parser.add_argument("--epochs", type=positive, metavar="N", help="of each network (default: 30, or 4 short ones with --small)")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of first weights, order and augmentation (default: 0)")
    parser.add_argument("--seeds", type=positive, default=1, metavar="N", help="networks of each kind, from --seed on (default: 1)")
    parser.add_argument("--small", action="store_true", help="few samples, autoencoders half as wide: five minutes each on two cores")
    parser.add_argument("--workers", type=positive, default=os.cpu_count() or 1, metavar="N", help="processes that cut samples")
    parser.add_argument("--resume", action="store_true", help="continue the runs in --out where they were interrupted")


def read(options: argparse.Namespace, track: Track) -> Material:
    """Of add_drives' arguments. Raises EchogridError."""
    check_folder(options.out)
    learned, held_out = split(find_drives(options.drives))
    tested = find_drives(options.test)
    check_apart([*learned, *held_out], tested, options.test)
    check_turns([*learned, *held_out, *tested])
    kinds = {"learned from": learned, "validation": held_out, "test": tested}
    samples = {name: load_drives(drives, track, whole=True, workers=options.workers) for name, drives in kinds.items()}
    parts = {name: Part(drives, len(samples[name]), samples[name].digest(), plans(drives)) for name, drives in kinds.items()}
    towns = [joined([load_drive(drive, whole=True) for drive in drives]) for drives in by_town(tested).values()]
    return Material(samples["learned from"], samples["validation"], towns, parts)


def plans(drives: Sequence[Path]) -> list[str]:
    """Of the campaigns that the drives are of, where their folders note one."""
    notes = (folder / PLAN for folder in sorted({drive.parent for drive in drives}))
    return [note.read_text("utf-8") for note in notes if note.is_file()]


def described(parts: Mapping[str, Part]) -> dict[str, Any]:
    """As JSON knows it."""
    return {
        name: {"drives": [drive.name for drive in part.drives], "samples": part.samples, "sha256": part.sha256, "plans": part.plans}
        for name, part in parts.items()
    }


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
