"""The command `echogrid-train evaluate sim`: networks and baselines on simulated towns. PyTorch is imported when it runs, not before."""

from __future__ import annotations

import argparse
import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from echogrid.errors import EchogridError
from echogrid.files import check_file, check_folder, meant
from echogrid_training.learning.dataset import find_drives
from echogrid_training.learning.fit import positive, some
from echogrid_training.recording import Track, untracked
from echogrid_training.tasks import processes

CALIBRATED = 8  # drives at most for patches
MAPPED = 4  # of them, drives that maps are calibrated on
PROBED = 2  # test drives that are also stood in, and driven twice


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("--test", type=Path, required=True, metavar="DIR", help="simulated drives to judge by")
    parser.add_argument("--calibrate", type=Path, required=True, metavar="DIR", help="simulated drives of other towns, to tune by")
    parser.add_argument(
        "--model",
        type=named,
        action="append",
        default=[],
        metavar="NAME=FILE",
        help="a network's .onnx, or the model.pt of an autoencoder of the lidar's image; as often as you like; "
        "files of one NAME are seeds of one network",
    )
    parser.add_argument("--patches", type=positive, default=60, metavar="N", help="of each test drive (default: 60)")
    parser.add_argument("--maps", action="store_true", help="maps along the drives alone: no patches, cold starts, standing or sweep")
    parser.add_argument("--sweep", action="store_true", help="also over density, mounting, silent radars; drives of its own in OUT/sweep")
    parser.add_argument("--workers", type=positive, default=os.cpu_count() or 1, metavar="N", help="processes")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="for results.json, results.md and pictures")
    parser.add_argument("--json", type=Path, metavar="FILE.json", help="results.json by another name (default: OUT/results.json)")


def named(text: str) -> tuple[str, Path]:
    """NAME=FILE."""
    name, _, path = text.partition("=")
    if not name or not path.endswith((".onnx", ".pt")):
        raise argparse.ArgumentTypeError(f"'{text}' found, expected NAME=FILE.onnx or NAME=FILE.pt")
    return name, Path(path)


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Calibrates, judges, writes; returns the tables in Markdown. Raises EchogridError."""
    if options.maps and options.sweep:
        raise EchogridError("--maps and --sweep found together, expected one of them: a sweep judges patches")
    check_folder(options.out)
    if options.json is not None:
        check_file(options.json, ".json")
    for _, path in options.model:
        if not path.is_file():
            raise EchogridError(f"--model {path}: there is no such file{meant(path)}")
    from echogrid_training.evaluation.simulated import calibrating, judging, results, sweep
    from echogrid_training.evaluation.simulated.learned import File
    from echogrid_training.evaluation.tables import report

    tested, others = find_drives(options.test), some(find_drives(options.calibrate), MAPPED if options.maps else CALIBRATED)
    check_apart(tested, others)
    files = [File(name, path) for name, path in options.model]
    mapped, probed = some(others, MAPPED), [] if options.maps else some(tested, PROBED)
    count = 0 if options.maps else options.patches
    with spread(options.workers, track) as each:
        shown = each(calibrating.shown, [(drive, files, not options.maps, drive in mapped) for drive in others], "calibrating")
        plan = calibrating.planned(shown, files)
        judged = each(judging.judged, [(drive, plan, count, drive in probed) for drive in tested], "judging")
        swept = each(sweep.swept, [(point, options.out / "sweep", plan) for point in sweep.points()], "sweeping") if options.sweep else []
    found = results.results(judged, plan, len(others)) | {"sweep": sweep.curves(swept)}
    return report.write(results.cleaned(found), judged, options.out, options.json)


def check_apart(tested: Sequence[Path], others: Sequence[Path]) -> None:
    """Raises EchogridError where a drive is on both sides."""
    truths = {hashlib.sha256((drive / "truth.npz").read_bytes()).digest(): drive for drive in tested}
    for drive in others:
        same = truths.get(hashlib.sha256((drive / "truth.npz").read_bytes()).digest())
        if same is not None:
            raise EchogridError(f"{drive}: is the test drive {same}, expected calibration drives through other towns")


Each = Callable[[Callable[..., Any], Sequence[tuple[Any, ...]], str], list[Any]]


@contextmanager
def spread(workers: int, track: Track) -> Iterator[Each]:
    """Calls a function with each of some arguments, in order, in so many processes; each of them on one core."""
    if workers == 1:
        yield lambda function, calls, what: [function(*arguments) for arguments in track(calls, what)]
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # read when a process loads numpy's and PyTorch's libraries
    with processes(workers) as pool:

        def each(function: Callable[..., Any], calls: Sequence[tuple[Any, ...]], what: str) -> list[Any]:
            pending = [pool.submit(function, *arguments) for arguments in calls]
            return [done.result() for done in track(pending, what)]

        yield each
