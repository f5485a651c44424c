"""`echogrid-train import own`: a user's own recording as a drive folder with its lidar.

echogrid.toml   the configuration as given, with the DBC files that it names
can.*           the CAN log as given
lidar.npz       stamp_ns (T,), offsets (T + 1,), xyz_cm (N, 3) int16 in its own frame; turn i begins at offsets[i]
lidar.toml      where the lidar is
poses.npz       where base was, if an odometry topic says so (odometry.py)
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.errors import EchogridError
from echogrid.files import check_folder, meant
from echogrid.logs.drive import ENDINGS, find_drive
from echogrid_training.evaluation.recorded.drive import hear
from echogrid_training.labelling.clouds import Cloud, clouds
from echogrid_training.labelling.lidar_mount import load_mount
from echogrid_training.labelling.odometry import POSES, read_odometry, write_poses
from echogrid_training.recording import Track, untracked
from echogrid_training.sources import load_npz

LIDAR, MOUNT, CONFIG = "lidar.npz", "lidar.toml", "echogrid.toml"
FARTHEST = 45.0  # m: farther points tell nothing that is used
KEYS = ("stamp_ns", "offsets", "xyz_cm")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What `run` reads."""
    parser.add_argument("log", type=Path, metavar="LOG", help="the CAN log, of any format that echogrid replays")
    parser.add_argument("-c", "--config", type=Path, required=True, metavar="FILE", help="its configuration")
    parser.add_argument(
        "--lidar", type=Path, required=True, metavar="PATH", help="an .mcap, a bag of ROS 2, or a folder of .npz, .pcd, .bin"
    )
    parser.add_argument("--topic", metavar="NAME", help="of the clouds, where there are several")
    parser.add_argument(
        "--odometry", type=Path, metavar="PATH", help="an .mcap or a bag with nav_msgs/Odometry: poses in place of our dead reckoning"
    )
    parser.add_argument("--odometry-topic", metavar="NAME", help="where there are several")
    parser.add_argument("--mount", type=Path, required=True, metavar="FILE.toml", help="where the lidar is: x, y, z, yaw_deg, …")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="the drive folder to write")


def run(options: argparse.Namespace, track: Track = untracked) -> str:
    """Writes the folder completely or not at all. Raises EchogridError."""
    out: Path = options.out
    check_folder(out)
    if out.exists():
        raise EchogridError(f"{out}: exists already; give another folder")
    config = load_config(options.config)
    mount = load_mount(options.mount)
    poses = None if options.odometry is None else read_odometry(options.odometry, options.odometry_topic, mount.odometry)
    files = [options.config.parent / name for name in named(config) if (options.config.parent / name).is_file()]
    for path in files:
        if options.config.parent.resolve() not in path.resolve().parents:
            raise EchogridError(f"{options.config}: names {path}, outside its folder; put it beside the configuration, for both are copied")
    if options.log.is_dir():
        raise EchogridError(f"{options.log}: is a folder, expected a recording, such as {options.log / 'can.log'}")
    if not options.log.is_file():
        raise EchogridError(f"{options.log}: there is no such file{meant(options.log)}")
    ending = next((one for ending in ENDINGS for one in (ending, f"{ending}.gz", f"{ending}.zst") if options.log.name.endswith(one)), None)
    if ending is None:
        raise EchogridError(f"{options.log}: expected a CAN log that ends in one of {', '.join(ENDINGS)}")
    partial = out.with_name(f".{out.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        shutil.copyfile(options.config, partial / CONFIG)
        for path in files:
            target = partial / path.resolve().relative_to(options.config.parent.resolve())
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
        shutil.copyfile(options.log, partial / f"can{ending}")
        shutil.copyfile(options.mount, partial / MOUNT)
        turns = list(track(clouds(options.lidar, options.topic), "reading the lidar"))
        first, last = (stamp_ns - round(mount.latency_ms * 1e6) for stamp_ns in span(turns, options.lidar))
        drive = hear(partial)
        began, ended = drive.items[0][0], drive.items[-1][0]
        _together(first, last, began, ended, f"{options.lidar}: its turns and {options.log}")
        if poses is not None:
            _together(
                first,
                last,
                int(poses.stamp_ns[0]),
                int(poses.stamp_ns[-1]),
                f"{options.odometry}: its poses and the turns of {options.lidar}",
            )
            write_poses(partial / POSES, poses)
        write_turns(partial / LIDAR, turns)
        partial.rename(out)
    except EchogridError as error:  # of the copy, which nobody knows
        theirs = str(error).replace(str(partial / f"can{ending}"), str(options.log)).replace(str(partial / CONFIG), str(options.config))
        raise EchogridError(theirs) from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    seconds, points = (last - first) * 1e-9, int(np.mean([len(turn.points) for turn in turns]))
    return f"{out}: {len(turns)} turns of {points} points in {seconds:.0f} s, {len(drive.scans)} scans of {len(config.radar)} radars"


def _together(first: int, last: int, began: int, ended: int, what: str) -> None:
    """Raises EchogridError unless two spans of time (ns) meet."""
    if last < began or first > ended:
        apart = (first - ended if first > ended else began - last) * 1e-9
        raise EchogridError(f"{what} are {apart:.1f} s apart; both need one clock")


def named(config: Config) -> list[str]:
    """Files that a configuration may name relative to itself."""
    names = [config.motion.dbc, config.motion.profile, *(name for radar in config.radar for name in (radar.dbc, radar.profile))]
    return sorted({name for name in names if name is not None and not Path(name).is_absolute()})


def span(turns: list[Cloud], source: Path) -> tuple[int, int]:
    """First and last stamp. Raises EchogridError where there is no turn."""
    if not turns:
        raise EchogridError(f"{source}: holds no turn of a lidar")
    stamps = [turn.stamp_ns for turn in turns]
    return min(stamps), max(stamps)


def write_turns(path: Path, turns: list[Cloud]) -> None:
    """`lidar.npz`."""
    near = [turn.points[(turn.points**2).sum(axis=1) < FARTHEST**2] for turn in turns]
    offsets = np.concatenate(([0], np.cumsum([len(points) for points in near])))
    xyz_cm = np.rint(np.concatenate(near) * 100).astype(np.int16)
    np.savez(path, stamp_ns=np.array([turn.stamp_ns for turn in turns], np.int64), offsets=offsets, xyz_cm=xyz_cm)


@dataclass(frozen=True, slots=True, eq=False)
class Turn:
    """One of a drive folder, as it is stored: ten minutes of them fit into memory."""

    stamp_ns: int
    xyz_cm: NDArray[np.int16]  # (N, 3) in the lidar's frame

    def cloud(self) -> Cloud:
        return Cloud(self.stamp_ns, self.xyz_cm / 100.0)


def read_turns(drive: Path) -> list[Turn]:
    """In order of time. Raises EchogridError."""
    if not drive.is_dir():
        what = "is a file, expected a drive's folder" if drive.exists() else f"there is no such folder{meant(drive)}"
        raise EchogridError(f"{drive}: {what}")
    if not (drive / LIDAR).is_file():
        held = sorted(path.parent for path in drive.glob(f"*/{LIDAR}"))
        if held:
            raise EchogridError(f"{drive}: holds drives with a lidar, expected one of them, such as {held[0]}")
        raise EchogridError(f"{drive}: has no {LIDAR}; bring its lidar with: echogrid-train import own")
    find_drive(drive, None)
    arrays = load_npz(drive / LIDAR, KEYS)
    offsets, points = arrays["offsets"], arrays["xyz_cm"]
    if len(offsets) != len(arrays["stamp_ns"]) + 1 or offsets[-1] != len(points):
        raise EchogridError(f"{drive / LIDAR}: its offsets do not fit its points")
    if len(offsets) == 1:
        raise EchogridError(f"{drive / LIDAR}: holds no turn of the lidar")
    order = np.argsort(arrays["stamp_ns"], kind="stable").tolist()
    return [Turn(int(arrays["stamp_ns"][index]), points[offsets[index] : offsets[index + 1]]) for index in order]
