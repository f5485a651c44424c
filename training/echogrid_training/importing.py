"""`echogrid-train import`: recordings as drive folders, public ones or one's own, one after the other or many at once."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from echogrid.errors import EchogridError
from echogrid_training.drives import nuscenes, radarscenes
from echogrid_training.drives.drive import check_free, write_drive
from echogrid_training.drives.frames import Report
from echogrid_training.labelling import bring
from echogrid_training.labelling.label import add_engine
from echogrid_training.layouts import kitti, nuscenes_lidar, vod
from echogrid_training.layouts.with_lidar import Brought, write
from echogrid_training.recording import Recording, Track, untracked
from echogrid_training.sources import load_text
from echogrid_training.tasks import done

Importer = Callable[[argparse.Namespace, Track], str]


class OneSentence(argparse.ArgumentParser):
    """Of a line in a file: a mistake is an EchogridError, and ends nothing."""

    def error(self, message: str) -> NoReturn:
        raise EchogridError(message)


def add_commands(sets: Any) -> None:
    """One a kind of recording, with `importer` among its defaults."""
    one = sets.add_parser("nuscenes", help="one scene: its four corner radars, with the CAN bus expansion, and its lidar if asked for")
    one.add_argument("source", type=Path, help="root of the official layout, a scene-XXXX.npz, or a folder of such files")
    one.add_argument("--scene", help="which scene, such as scene-0061, where SOURCE holds several")
    one.add_argument("--lidar", action="store_true", help="LIDAR_TOP of the official layout too, for `label`")
    one.set_defaults(importer=_nuscenes)
    other = sets.add_parser("radarscenes", help="one sequence: its four radars")
    other.add_argument("source", type=Path, help="an official folder sequence_N, or a seq_N.npz")
    other.set_defaults(importer=_radarscenes)
    delft = sets.add_parser("vod", help="frames of View of Delft: its lidar and its one front radar")
    delft.add_argument("source", type=Path, help="root of the official layout, which holds lidar and radar")
    delft.add_argument("--frames", type=_frames, required=True, metavar="FIRST-LAST", help="of one sequence, such as 0-543")
    delft.set_defaults(importer=_vod)
    karlsruhe = sets.add_parser("kitti", help="one drive of KITTI: its lidar, and corner radars played from it, for it has none")
    karlsruhe.add_argument(
        "source", type=Path, help="a drive of the raw data, a sequence of the odometry benchmark with poses.txt, or a compact .npz"
    )
    karlsruhe.set_defaults(importer=_kitti)
    for command in (one, other, delft, karlsruhe):
        add_out(command)

    mine = sets.add_parser("own", help="your own recording: a CAN log with a lidar's bag or folder of points")
    bring.add_arguments(mine)
    mine.set_defaults(importer=bring.run)


def add_many(sets: Any) -> None:
    """Many of them at once."""
    many = sets.add_parser("many", help="what a file says, an import a line; what is there already is left as it is")
    many.add_argument("file", type=Path, metavar="FILE", help="lines such as: own can.log -c echogrid.toml --lidar … --out drives/a")
    add_engine(many)
    many.set_defaults(importer=_many)


def add_out(command: argparse.ArgumentParser) -> None:
    command.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="the drive folder to write")
    command.add_argument("--classic", action="store_true", help="classic CAN radars instead of CAN FD ones")
    command.add_argument("--force", action="store_true", help="replace an existing drive")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """What the command of this kind of recording says when it is done. Raises EchogridError."""
    importer: Importer = options.importer
    return importer(options, track)


def _nuscenes(options: argparse.Namespace, track: Track) -> str:
    if options.lidar:
        return _with_lidar(options, lambda: nuscenes_lidar.load(options.source, options.scene, track), track)
    check_free(options.out, options.force)
    return _written(options, nuscenes.load(options.source, options.scene, track), track)


def _radarscenes(options: argparse.Namespace, track: Track) -> str:
    check_free(options.out, options.force)
    return _written(options, radarscenes.load(options.source), track)


def _vod(options: argparse.Namespace, track: Track) -> str:
    return _with_lidar(options, lambda: vod.load(options.source, options.frames, track), track)


def _kitti(options: argparse.Namespace, track: Track) -> str:
    return _with_lidar(options, lambda: kitti.load(options.source, track), track)


def _written(options: argparse.Namespace, recording: Recording, track: Track) -> str:
    return summary(recording, write_drive(recording, options.out, fd=not options.classic, force=options.force, track=track), options.out)


def _with_lidar(options: argparse.Namespace, load: Callable[[], Brought], track: Track) -> str:
    check_free(options.out, options.force)
    brought = load()
    report = write(brought, options.out, fd=not options.classic, force=options.force, track=track)
    return f"{summary(brought.recording, report, options.out)}\n  with its lidar and poses: echogrid-train label {options.out}"


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


def _many(options: argparse.Namespace, track: Track) -> str:
    tasks = _tasks(options.file)
    return "\n".join(done(carried_out, tasks, "importing drives", track, options.workers, options.scheduler))


def _tasks(file: Path) -> list[argparse.Namespace]:
    """Of each line, with paths that hold anywhere. Raises EchogridError naming the line."""
    parser = OneSentence(prog="import", add_help=False)
    add_commands(parser.add_subparsers(required=True, metavar="DATASET"))
    tasks: list[argparse.Namespace] = []
    for number, line in enumerate(load_text(file).splitlines(), 1):
        try:
            words = shlex.split(line, comments=True)
            if not words:
                continue
            task = parser.parse_args(words)
        except (EchogridError, ValueError, argparse.ArgumentError) as error:
            raise EchogridError(f"{file}: line {number}: {error}") from error
        for name, value in vars(task).items():
            if isinstance(value, Path):
                setattr(task, name, value.absolute())
        if any(task.out == other.out for other in tasks):
            raise EchogridError(f"{file}: line {number}: {task.out} is written by a line before it too")
        tasks.append(task)
    if not tasks:
        raise EchogridError(f"{file}: holds no line that imports something")
    return tasks


def carried_out(task: argparse.Namespace) -> str:
    """One line; a folder that is there was written completely, and is left as it is."""
    if task.out.is_dir() and any(task.out.iterdir()):
        return f"{task.out}: is there already"
    return run(task)


def _frames(text: str) -> tuple[int, int]:
    first, _, last = text.partition("-")
    if not (first.isdecimal() and last.isdecimal() and int(first) < int(last)):
        raise argparse.ArgumentTypeError(f"'{text}' found, expected two numbers such as 0-543")
    return int(first), int(last)
