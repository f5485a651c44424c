"""The command `echogrid-train reproduce`: the paper's four autoencoders, its table and its figures on simulated drives, as one HTML page.

PyTorch is imported when it runs, not before.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from typing import Any

from echogrid_training.learning.fit import add_choices
from echogrid_training.paper.material import add_drives, read
from echogrid_training.recording import Track, untracked

PAGE, FIGURES = "reproduction.html", "reproduction.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    add_drives(parser, f"for {PAGE}, its pictures, and a folder for each network")
    add_choices(parser, "loss")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Trains, judges, maps, draws and writes; returns the table in Markdown. Raises EchogridError."""
    data = read(options, track)
    from echogrid_training.learning import train
    from echogrid_training.paper import autoencoders, reproduction, reproduction_report, table_one

    plain = (train.small if options.small else train.Settings)("paper", "independent", seed=options.seed)
    chosen: dict[str, Any] = {} if options.epochs is None else {"epochs": options.epochs}
    chosen |= {"labels": options.labels, "l2": options.l2}
    settings = [replace(plain, seed=options.seed + number, **chosen) for number in range(options.seeds)]
    networks = autoencoders.reproduce(data.learned, data.held_out, data.towns, settings, options.out, resume=options.resume, track=track)
    made = reproduction.reproduction(networks, data.parts, track)
    for name, png in made.pictures.items():
        (options.out / f"{name}.png").write_bytes(png)
    (options.out / PAGE).write_text(reproduction_report.page(made), "utf-8")
    (options.out / FIGURES).write_text(json.dumps(reproduction_report.figures(made), indent=1) + "\n", "utf-8")
    return f"{options.out / PAGE}\n\n{table_one.markdown(made.table)}"
