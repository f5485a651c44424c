"""`echogrid-train label`: a drive's truth out of its lidar, as the simulator writes it, a picture of it, and what to distrust."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from echogrid.config.loading import load_config
from echogrid.core.messages import RadarScan
from echogrid.errors import EchogridError
from echogrid.maps.picture import draw
from echogrid_training.evaluation.recorded.drive import hear
from echogrid_training.labelling.bring import LIDAR, MOUNT, read_turns
from echogrid_training.labelling.distrust import doubts
from echogrid_training.labelling.lidar_mount import load_mount
from echogrid_training.labelling.lidar_truth import build, placed, way
from echogrid_training.recording import Track, untracked

TRUTH, PICTURE, REPORT = "truth.npz", "label.png", "label.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("drives", type=Path, nargs="+", metavar="DRIVE", help="drive folders with a lidar, as `import own` writes them")
    parser.add_argument("--force", action="store_true", help="replace a truth that is there")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Writes truth, picture and report into each folder; returns what to distrust. Raises EchogridError."""
    return "\n".join(label(drive, track, force=options.force) for drive in options.drives)


def label(folder: Path, track: Track = untracked, *, force: bool = False) -> str:
    """One drive. Raises EchogridError."""
    if (folder / TRUTH).exists() and not force:
        raise EchogridError(f"{folder / TRUTH}: is there already; give --force to make it anew")
    clouds = read_turns(folder)
    mount, drive = load_mount(folder / MOUNT), hear(folder)
    config = load_config(drive.config)
    turns, missed = placed(drive, config, track(clouds, "placing turns"), mount)
    if not turns:
        raise EchogridError(f"{folder / LIDAR}: none of its {missed} turns lies where there are speed and yaw rate")
    motion = [item for _, item in drive.items if not isinstance(item, RadarScan)]
    found = doubts(turns, missed, motion, mount, config)
    stamps, poses = way(turns)
    truth, turn_ns, ranges = build(track(turns, "summing turns"), poses[:, :2], mount, config)
    arrays: dict[str, np.ndarray] = {"stamp_ns": stamps, "x": poses[:, 0], "y": poses[:, 1], "yaw": poses[:, 2]}
    arrays |= {"log_odds": truth.log_odds, "origin": np.array(truth.origin), "cell": np.array(truth.cell)}
    arrays |= {"lidar_stamp_ns": turn_ns, "lidar_cm": np.where(np.isfinite(ranges), np.rint(ranges * 100), 0).astype(np.uint16)}
    partial = folder / f".{TRUTH}.partial.npz"
    np.savez_compressed(partial, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the keywords for allow_pickle
    partial.replace(folder / TRUTH)
    draw(truth.log_odds, truth.origin, truth.cell, poses[:, :2]).save(folder / PICTURE)
    report = {"turns": len(turns), "without_pose": missed, "distrust": [asdict(one) for one in found]}
    (folder / REPORT).write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    area = truth.cell**2
    seen, occupied = int(truth.observed.sum()) * area, int((truth.log_odds > 0).sum()) * area
    lines = [f"{folder / TRUTH}: {len(turns)} turns, {seen:.0f} m² observed, {occupied:.0f} m² of it occupied; picture {folder / PICTURE}"]
    return "\n".join(lines + [f"  {one.code}: {one.sentence}" for one in found])
