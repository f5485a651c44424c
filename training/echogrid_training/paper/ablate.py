"""The command `echogrid-train ablate`: which of the differences between the paper's network and the default one does what.

PyTorch is imported when it runs, not before.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import Any

from echogrid_training.paper.material import add_drives, described, read
from echogrid_training.recording import Track, untracked

FIGURES = "ablation.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    add_drives(parser, f"for {FIGURES}, and a folder for each network")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Trains, judges and writes; returns the tables in Markdown. Raises EchogridError."""
    data = read(options, track)
    from echogrid_training.learning import train
    from echogrid_training.paper import variants

    plain = (train.small if options.small else train.Settings)("paper", "independent", seed=options.seed)
    chosen: dict[str, Any] = {} if options.epochs is None else {"epochs": options.epochs}
    settings = [replace(plain, seed=options.seed + number, **chosen) for number in range(options.seeds)]
    found = variants.try_all(data.learned, data.held_out, data.towns, settings, options.out, resume=options.resume, track=track)
    held = variants.figures(found) | {"parts": described(data.parts)}
    (options.out / FIGURES).write_text(json.dumps(held, indent=1) + "\n", "utf-8")
    return f"{options.out / FIGURES}\n\n{variants.markdown(held)}"
