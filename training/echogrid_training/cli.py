"""echogrid-train: drives out of recordings and simulated towns; networks that learn from them; what a map is worth on them."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, track

from echogrid.arguments import Parser as Guessing
from echogrid.arguments import any_terminal, between, complete, unread
from echogrid.errors import EchogridError
from echogrid.files import check_file, sentence
from echogrid_training import importing
from echogrid_training.drives import campaign, demo, inspect_drive
from echogrid_training.drives.drive import check_free, write_drive
from echogrid_training.evaluation import motion, real, sim
from echogrid_training.labelling import label
from echogrid_training.learning import fit
from echogrid_training.own import adapt
from echogrid_training.own import evaluate as own
from echogrid_training.own.likeness import likenesses
from echogrid_training.paper import ablate, reproduce
from echogrid_training.realism import report
from echogrid_training.recording import Recording, Track
from echogrid_training.streets.style import FAMILIES
from echogrid_training.truth.ground_truth import TruthMap
from echogrid_training.worlds.scene import drive

# What `COMMAND --help` ends with.
EXAMPLES = {
    "": ("simulate --family train --towns 100 --out drives", "fit --drives drives --out models", "evaluate own drives/monday"),
    "import": ("import nuscenes scene-0061.npz --out drives/scene-0061",),
    "import nuscenes": ("import nuscenes /data/nuscenes --scene scene-0061 --out drives/scene-0061",),
    "import radarscenes": ("import radarscenes RadarScenes/data/sequence_105 --out drives/seq_105",),
    "import vod": ("import vod view_of_delft --frames 0-543 --out drives/delft",),
    "import kitti": ("import kitti 2011_09_26/2011_09_26_drive_0005_sync --out drives/karlsruhe",),
    "import many": ("import many drives.txt --workers 8", "import many drives.txt --scheduler tcp://10.0.0.1:8786"),
    "import own": ("import own can.blf -c echogrid.toml --lidar lidar.mcap --mount lidar.toml --out drives/monday",),
    "scene": ("scene --out drives/scene",),
    "demo": ("demo --out drives/demo",),
    "simulate": (
        "simulate --family train --towns 100 --seed 1 --out drives",
        "simulate --osm town.osm.pbf --towns 5 --out drives",
        "simulate --family train --towns 8 --like drives/monday --out towns",
    ),
    "label": ("label drives/monday drives/tuesday", "label drives/hills --ground followed"),
    "inspect": ("inspect drives/train-00000 --out look",),
    "fit": ("fit --drives drives --test test --out models", "fit --drives drives --small --out models"),
    "reproduce": ("reproduce --drives drives --test test --seeds 3 --out reproduction",),
    "ablate": ("ablate --drives drives --test test --out ablation",),
    "evaluate": ("evaluate own drives/monday --report worth.html",),
    "evaluate sim": ("evaluate sim --test test --calibrate others --out scores --model default=models/default.onnx",),
    "evaluate real": ("evaluate real nuscenes scene-0061.npz --json scores.json --out pictures",),
    "evaluate motion": ("evaluate motion drives/monday drives/tuesday",),
    "evaluate own": ("evaluate own drives/monday drives/tuesday --report worth.html --json worth.json",),
    "adapt": (
        "adapt default drives/monday drives/tuesday --simulated towns --out mine.onnx",
        "adapt default drives/monday --calibrate-only --out mine.onnx",
    ),
    "report": ("report --nuscenes scenes --radarscenes seq_105.npz --astyx astyx.npz --kitti kitti.npz",),
}
FIRST_S = 10.0  # until a line of progress, and between two


class Parser(Guessing):
    """With our own examples."""

    examples = EXAMPLES


def main(arguments: list[str] | None = None) -> int:
    """Returns the exit status: 0, or 1 after a sentence on stderr, 130 after Ctrl-C, or 141 where nobody reads any more."""
    any_terminal()
    parser = _parser()
    if "_ARGCOMPLETE" in os.environ:
        complete(parser)
    options = parser.parse_args(arguments)
    try:
        options.command(options)
        sys.stdout.flush()
    except EchogridError as error:
        print(error, file=sys.stderr)
        return 1
    except BrokenPipeError:
        unread()
        return 141
    except OSError as error:
        print(sentence(error), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="echogrid-train", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    importer = commands.add_parser("import", help="a recording as a drive folder: public, or your own with a lidar")
    sets = importer.add_subparsers(required=True, metavar="DATASET")
    importing.add_commands(sets)
    importing.add_many(sets)
    for command in sets.choices.values():
        command.set_defaults(command=_printed(importing.run))

    scene = commands.add_parser("scene", help="a small generated street scene of 40 s: no antenna, no materials")
    scene.add_argument("--seed", type=int, default=0, help="of the noise; the same seed makes the same bytes (default: 0)")
    scene.set_defaults(command=_scene)
    shipped = commands.add_parser("demo", help="the demonstration drive that the service ships")
    shipped.set_defaults(command=_demo)
    for command in (scene, shipped):
        importing.add_out(command)

    towns = commands.add_parser("simulate", help="drives through simulated towns, one folder each; a killed run continues where it was")
    place = towns.add_mutually_exclusive_group(required=True)
    place.add_argument("--family", choices=FAMILIES, help="layout family of the towns")
    place.add_argument("--osm", type=Path, metavar="FILE", help="an OpenStreetMap extract, .osm or .osm.pbf, instead")
    towns.add_argument("--towns", type=fit.positive, required=True, metavar="N", help="how many drives")
    towns.add_argument("--seconds", type=_seconds, default=60.0, metavar="T", help="of each drive (default: 60)")
    towns.add_argument("--seed", type=int, default=0, metavar="S", help="the same seed makes the same drives (default: 0)")
    seen = towns.add_mutually_exclusive_group()
    seen.add_argument("--sensors", choices=campaign.SENSORS, default="drawn", help="of every drive (default: drawn)")
    seen.add_argument("--like", type=Path, nargs="+", metavar="DRIVE", help="radars like those of the cars of these drives, by turns")
    towns.add_argument("--workers", type=fit.positive, default=os.cpu_count() or 1, metavar="N", help="processes; the result is the same")
    towns.add_argument("--out", type=Path, required=True, metavar="DIR", help="a folder for the drives' folders")
    towns.add_argument("--lidar", action="store_true", help="also write each drive's lidar, as a bag of ROS 2 would hold it: lidar.mcap")
    towns.set_defaults(command=_simulate)

    truth = commands.add_parser("label", help="the true map of your own drives, out of their lidar")
    label.add_arguments(truth)
    truth.set_defaults(command=_printed(label.run))

    look = commands.add_parser("inspect", help="detections, lidar, truth and pose of a simulated drive: a picture and an animation")
    look.add_argument("drive", type=Path, metavar="DRIVE", help="a folder that `simulate` wrote")
    look.add_argument("--out", type=Path, required=True, metavar="DIR", help="for drive.png and drive.gif")
    look.set_defaults(command=_inspect)

    learn = commands.add_parser("fit", help="train a network on simulated drives, and write it as ONNX")
    fit.add_arguments(learn)
    learn.set_defaults(command=_printed(fit.run))

    again = commands.add_parser("reproduce", help="the paper's four autoencoders, its table and its figures, as an HTML page")
    reproduce.add_arguments(again)
    again.set_defaults(command=_printed(reproduce.run))

    apart = commands.add_parser("ablate", help="what the paper's network and the default one differ in, one thing at a time, as tables")
    ablate.add_arguments(apart)
    apart.set_defaults(command=_printed(ablate.run))

    judge = commands.add_parser("evaluate", help="networks and plain methods side by side, as tables in Markdown")
    worlds = judge.add_subparsers(required=True, metavar="WORLD")
    simulated = worlds.add_parser("sim", help="on simulated towns, beside the truth")
    sim.add_arguments(simulated)
    simulated.set_defaults(command=_printed(sim.run))
    recorded = worlds.add_parser("real", help="on public recordings, by detections that were left out, or beside a lidar")
    real.add_arguments(recorded)
    recorded.set_defaults(command=_printed(real.run))
    reckoned = worlds.add_parser("motion", help="dead reckoning beside true poses, with and without what is learned")
    motion.add_arguments(reckoned)
    reckoned.set_defaults(command=_printed(motion.run))
    yours = worlds.add_parser("own", help="on your own drives, without any truth: half of the scans judge the map of the others")
    own.add_arguments(yours)
    yours.set_defaults(command=_printed(own.run))

    closer = commands.add_parser("adapt", help="a model for your car, out of your drives without any truth")
    adapt.add_arguments(closer)
    closer.set_defaults(command=_printed(adapt.run))

    compare = commands.add_parser("report", help="simulated drives beside recorded ones, as a table in Markdown")
    for name, what in (("nuscenes", "folder of scene-*.npz"), ("radarscenes", "seq_N.npz"), ("astyx", ".npz"), ("kitti", ".npz")):
        compare.add_argument(f"--{name}", type=Path, required=True, help=what)
    compare.add_argument("--drives", type=fit.positive, default=24, metavar="N", help="simulated (default: 24)")
    compare.add_argument("--seconds", type=_seconds, default=20.0, metavar="T", help="of each (default: 20)")
    compare.add_argument("--workers", type=fit.positive, default=os.cpu_count() or 1, metavar="N")
    compare.add_argument("--into", type=Path, metavar="FILE", help="put the table into a document, between its marks")
    compare.set_defaults(command=_report)
    return parser


def _printed(run: Callable[[argparse.Namespace, Track], str]) -> Callable[[argparse.Namespace], None]:
    """The command that prints what `run` says when it is done."""
    return lambda options: print(run(options, _tracked()))


def _seconds(text: str) -> float:
    return between(text, 5, 600, "found, expected seconds")


def _scene(options: argparse.Namespace) -> None:
    check_free(options.out, options.force)
    _write(options, drive(demo.demo_scene(), demo.demo_path(), options.seed, track=_tracked()), seed=options.seed)


def _demo(options: argparse.Namespace) -> None:
    check_free(options.out, options.force)
    _write(options, *demo.town_drive(_tracked()))


def _write(options: argparse.Namespace, recording: Recording, truth_map: TruthMap | None = None, seed: int = 0) -> None:
    written = write_drive(
        recording, options.out, fd=not options.classic, seed=seed, force=options.force, truth_map=truth_map, track=_tracked()
    )
    print(importing.summary(recording, written, options.out))


def _simulate(options: argparse.Namespace) -> None:
    plan = campaign.Campaign(
        options.family or "osm",
        options.towns,
        options.seconds,
        options.seed,
        options.osm and str(options.osm),
        options.sensors,
        options.lidar,
        likenesses(options.like, None, _tracked()) if options.like else (),
    )
    what, said = f"simulating {options.towns} drives", _Said()
    with Progress(console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(what, total=options.towns)

        def on_done(name: str) -> None:
            bar.advance(task)
            if not sys.stderr.isatty():
                said.add(f"{what}: {name} is there")

        made = campaign.run(plan, options.out, options.workers, on_done)
    print(f"{options.out}: {options.towns} drives of {options.seconds:g} s, {made} of them made now")


def _inspect(options: argparse.Namespace) -> None:
    for path in inspect_drive.inspect(options.drive, options.out):
        print(path)


def _report(options: argparse.Namespace) -> None:
    if options.into is not None:
        check_file(options.into)
        report.around(options.into)
    real = report.recorded(options.nuscenes, options.radarscenes, options.astyx, options.kitti)
    sims = report.simulated_drives(options.drives, options.seconds, options.workers, _tracked())
    table = report.table(real, sims)
    if options.into is None:
        print(table)
    else:
        report.put_into(options.into, table)


def _tracked() -> Track:
    return _with_bar if sys.stderr.isatty() else _with_lines


def _with_bar(things: Iterable[Any], what: str) -> Iterable[Any]:
    return track(things, what, console=Console(stderr=True), transient=True)


def _with_lines(things: Iterable[Any], what: str) -> Iterator[Any]:
    """For a log: how many are done, now and then, of what takes long."""
    said, of = _Said(), f" of {len(things)}" if isinstance(things, Sized) else ""
    for number, thing in enumerate(things):
        said.add(f"{what}: {number}{of}")
        yield thing


class _Said:
    """Remembers when a line is due again."""

    def __init__(self) -> None:
        self._due = time.monotonic() + FIRST_S

    def add(self, line: str) -> None:
        if time.monotonic() >= self._due:
            self._due = time.monotonic() + FIRST_S
            print(line, file=sys.stderr, flush=True)
