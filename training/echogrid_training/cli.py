"""echogrid-train: makes drives to replay, out of public recordings or of a generated scene."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from echogrid.errors import EchogridError
from echogrid_training import nuscenes, radarscenes
from echogrid_training.demo import demo_path, demo_scene
from echogrid_training.drive import check_free, write_drive
from echogrid_training.frames import Report
from echogrid_training.recording import Recording, Track, untracked
from echogrid_training.scene import drive


def main(arguments: list[str] | None = None) -> int:
    """Returns the exit status: 0, or 1 after a sentence on stderr."""
    options = _parser().parse_args(arguments)
    try:
        check_free(options.out, options.force)
        tracked = _with_bar if sys.stderr.isatty() else untracked
        recording, seed = options.make(options, tracked)
        report = write_drive(recording, options.out, fd=not options.classic, seed=seed, force=options.force, track=tracked)
    except EchogridError as error:
        print(error, file=sys.stderr)
        return 1
    except OSError as error:
        print(f"{error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    print(summary(recording, report, options.out))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="echogrid-train", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    importer = commands.add_parser("import", help="a public recording as a drive folder")
    sets = importer.add_subparsers(required=True, metavar="DATASET")
    one = sets.add_parser("nuscenes", help="one scene: its four corner radars, with the CAN bus expansion")
    one.add_argument("source", type=Path, help="root of the official layout, a scene-XXXX.npz, or a folder of such files")
    one.add_argument("--scene", help="which scene, such as scene-0061, where SOURCE holds several")
    one.set_defaults(make=_nuscenes)
    other = sets.add_parser("radarscenes", help="one sequence: its four radars")
    other.add_argument("source", type=Path, help="an official folder sequence_N, or a seq_N.npz")
    other.set_defaults(make=_radarscenes)

    scene = commands.add_parser("scene", help="the demonstration drive: a generated street scene of 40 s")
    scene.add_argument("--seed", type=int, default=0, help="of the noise; the same seed makes the same bytes (default: 0)")
    scene.set_defaults(make=_scene)

    for command in (one, other, scene):
        command.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="the drive folder to write")
        command.add_argument("--classic", action="store_true", help="classic CAN radars instead of CAN FD ones")
        command.add_argument("--force", action="store_true", help="replace a drive that is there")
    return parser


def _nuscenes(options: argparse.Namespace, tracked: Track) -> tuple[Recording, int]:
    return nuscenes.load(options.source, options.scene, tracked), 0


def _radarscenes(options: argparse.Namespace, _: Track) -> tuple[Recording, int]:
    return radarscenes.load(options.source), 0


def _scene(options: argparse.Namespace, tracked: Track) -> tuple[Recording, int]:
    return drive(demo_scene(), demo_path(), options.seed, track=tracked), options.seed


def _with_bar(things: Iterable[Any], what: str) -> Iterable[Any]:
    return track(things, what, console=Console(stderr=True), transient=True)


def summary(recording: Recording, report: Report, folder: Path) -> str:
    """What was written, and what was left out."""
    loads = ", ".join(f"{bus} {load:.0%}" for bus, load in report.loads.items())
    lines = [
        f"{folder}: {recording.vehicle}, {report.cycles} cycles of {len(recording.radars)} radars in {report.frames} frames, load {loads}",
        f"  {report.sent} detections sent, {report.beyond_nearest} beyond the nearest 64 of their cycle left out, "
        f"{report.unencodable} left out since a value does not fit its signal",
    ]
    if report.invalid_motion:
        lines.append(f"  {report.invalid_motion} wheel speeds and yaw rates marked invalid since they do not fit their signal")
    return "\n".join(lines)
