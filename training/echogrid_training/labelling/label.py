"""`echogrid-train label`: a drive's truth out of its lidar, as the simulator writes it, a picture of it, and what to distrust.

truth.npz is written last: a drive that has it is done, one without it, or with a torn one, is labelled again.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from echogrid.config.loading import load_config
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid.maps.picture import draw
from echogrid_training.evaluation.recorded.drive import hear
from echogrid_training.labelling.bring import LIDAR, MOUNT, read_turns
from echogrid_training.labelling.distrust import Doubt, doubts
from echogrid_training.labelling.ground import GROUNDS
from echogrid_training.labelling.lidar_mount import load_mount
from echogrid_training.labelling.lidar_truth import build, placed, reckoning, way
from echogrid_training.labelling.odometry import POSES, load_poses
from echogrid_training.learning.fit import positive
from echogrid_training.recording import Track, untracked
from echogrid_training.tasks import done
from echogrid_training.truth.ground_truth import TruthMap
from echogrid_training.truth.simulated_truth import load_simulated_truth

TRUTH, PICTURE, REPORT = "truth.npz", "label.png", "label.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("drives", type=Path, nargs="+", metavar="DRIVE", help="drive folders with a lidar, as `import` writes them")
    parser.add_argument(
        "--ground", choices=GROUNDS, default="flat", help="followed: for streets that rise and fall, instead of one height (default: flat)"
    )
    parser.add_argument("--force", action="store_true", help="replace a truth that is there")
    add_engine(parser)


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Where tasks are done."""
    parser.add_argument(
        "--workers", type=positive, default=os.cpu_count() or 1, metavar="N", help="processes for several drives; the result is the same"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="a Dask cluster instead; its workers see the drives under the same paths")


@dataclass(frozen=True, slots=True)
class Task:
    """One drive, as any process finds it."""

    folder: Path
    ground: str
    force: bool


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Writes truth, picture and report into each folder; returns what to distrust. Raises EchogridError."""
    tasks = [Task(folder.absolute() if options.scheduler else folder, options.ground, options.force) for folder in options.drives]
    if len(tasks) == 1 and options.scheduler is None:
        return label(tasks[0], track)
    return "\n".join(done(label, tasks, "labelling drives", track, options.workers, options.scheduler))


def label(task: Task, track: Track = untracked) -> str:
    """One drive; returns what to distrust. One that is done is left as it is. Raises EchogridError."""
    folder = task.folder
    turns = read_turns(folder)
    made_of = source(folder, task.ground)
    if not task.force and _whole(folder, made_of):
        return f"{folder / TRUTH}: is done already; --force makes it anew"
    mount, drive, poses = load_mount(folder / MOUNT), hear(folder), load_poses(folder / POSES)
    config = load_config(drive.config)
    where = reckoning(drive) if poses is None else poses.at
    clouds = (turn.cloud() for turn in track(turns, "placing turns"))
    laid, missed = placed(drive, config, clouds, mount, where, GROUNDS[task.ground])
    if not laid:
        known = "speed and yaw rate" if poses is None else "poses"
        raise EchogridError(f"{folder / LIDAR}: none of its {missed} turns lies where there are {known}")
    found = doubts(laid, missed, where, mount, config, level=task.ground == "flat")
    stamps, driven = way(laid)
    truth, turn_ns, ranges = build(track(laid, "summing turns"), driven[:, :2], mount, config)
    arrays: dict[str, np.ndarray] = {"stamp_ns": stamps, "x": driven[:, 0], "y": driven[:, 1], "yaw": driven[:, 2]}
    arrays |= {"log_odds": truth.log_odds, "origin": np.array(truth.origin), "cell": np.array(truth.cell)}
    arrays |= {"lidar_stamp_ns": turn_ns, "lidar_cm": np.where(np.isfinite(ranges), np.rint(ranges * 100), 0).astype(np.uint16)}
    (folder / TRUTH).unlink(missing_ok=True)  # a report is never beside another's truth
    draw(truth.log_odds, truth.origin, truth.cell, driven[:, :2]).save(folder / PICTURE)
    report = {"turns": len(laid), "without_pose": missed, "ground": task.ground, "poses": "odometry" if poses else "dead reckoning"}
    _write_report(folder, report | {"distrust": [asdict(one) for one in found], "source": made_of})
    partial_file = folder / f".{TRUTH}.partial.npz"
    np.savez_compressed(partial_file, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the keywords for allow_pickle
    partial_file.replace(folder / TRUTH)
    return said(folder, truth, len(laid), found)


def source(folder: Path, ground: str) -> str:
    """SHA-256 of all that a truth is made of."""
    drive, total = find_drive(folder, None), hashlib.sha256(ground.encode())
    for path in (drive.config, drive.log, folder / LIDAR, folder / MOUNT, folder / POSES):
        if path.is_file():
            with path.open("rb") as file:
                total.update(path.name.encode() + hashlib.file_digest(file, "sha256").digest())
    return total.hexdigest()


def _whole(folder: Path, made_of: str) -> bool:
    """Whether a truth is there that this command made of the same files. Raises EchogridError where it is somebody else's."""
    if not (folder / TRUTH).exists():
        return False
    try:
        before: Any = json.loads((folder / REPORT).read_text("utf-8"))["source"]
    except (OSError, ValueError, KeyError, TypeError):
        raise EchogridError(f"{folder / TRUTH}: is there already, and not by this command; give --force to replace it") from None
    if before != made_of:
        raise EchogridError(f"{folder / TRUTH}: was made of other files or another --ground; give --force to make it anew")
    try:
        load_simulated_truth(folder / TRUTH)
    except EchogridError:  # torn
        return False
    return True


def _write_report(folder: Path, report: dict[str, Any]) -> None:
    partial_file = folder / f".{REPORT}.partial"
    partial_file.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    partial_file.replace(folder / REPORT)


def said(folder: Path, truth: TruthMap, turns: int, found: list[Doubt]) -> str:
    """What was written, and what to distrust."""
    area = truth.cell**2
    seen, occupied = int(truth.observed.sum()) * area, int((truth.log_odds > 0).sum()) * area
    lines = [f"{folder / TRUTH}: {turns} turns, {seen:.0f} m² observed, {occupied:.0f} m² of it occupied; picture {folder / PICTURE}"]
    return "\n".join(lines + [f"  {one.code}: {one.sentence}" for one in found])
