"""A drive folder: a recording as the service replays it, with the truth beside it.

    echogrid.toml   the configuration: buses, motion, radars and their mounts
    can.log.gz      every frame, in candump's format
    truth.npz       stamp_ns int64; x, y, yaw float64 of base (m, rad; the first pose is 0, 0, 0); walls (W, 2, 2) where they are known;
                    with a true map also log_odds (H, W) float32, origin (2,) and cell (m), as in ground_truth.TruthMap

    lidar.mcap      with lidar.toml, where a simulated lidar's points were asked for (lidar_writer.py)

The same recording and seed give the same bytes.
"""

from __future__ import annotations

import gzip
import io
import math
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

import can
import numpy as np
from can.io.canutils import CanutilsLogWriter

from echogrid.errors import EchogridError
from echogrid.files import check_folder
from echogrid_training.drives.bus import BITRATE, DATA_BITRATE
from echogrid_training.drives.can_writer import Wiring, can_frames
from echogrid_training.drives.frames import Report
from echogrid_training.drives.radar_writer import RadarLayout
from echogrid_training.recording import Recording, Track, untracked
from echogrid_training.truth.ground_truth import TruthMap

CONFIG, LOG, TRUTH, LIDAR, MOUNT = "echogrid.toml", "can.log.gz", "truth.npz", "lidar.mcap", "lidar.toml"
LABELLED = ("lidar.npz", "poses.npz", "label.png", "label.json")  # what the room `labelling` adds


def write_drive(
    recording: Recording,
    folder: Path,
    *,
    truth_map: TruthMap | None = None,
    fd: bool = True,
    seed: int = 0,
    force: bool = False,
    track: Track = untracked,
    beside: Callable[[Path], None] | None = None,
) -> Report:
    """Writes the recording's drive folder completely or not at all. With `force` it replaces an existing drive.

    `fd`: CAN FD radars, else classic ones; `seed` draws the radars' processing times; `beside` writes more into the folder that it is
    given. Raises EchogridError.
    """
    check_free(folder, force)
    messages, wirings, report = can_frames(recording, fd, seed, track)
    try:
        _write(recording, truth_map, folder, fd, messages, wirings, len(report.loads), beside)
    except OSError as error:
        raise EchogridError(f"{folder}: the drive cannot be written: {error.strerror}") from error
    return report


def check_free(folder: Path, force: bool) -> None:
    """Raises EchogridError unless a drive may be written there."""
    check_folder(folder)
    found = sorted(entry.name for entry in folder.iterdir()) if folder.exists() else []
    foreign = [name for name in found if name not in (CONFIG, LOG, TRUTH, LIDAR, MOUNT, *LABELLED)]
    if foreign and force:
        raise EchogridError(f"{folder}: holds '{foreign[0]}', which is not part of a drive, so --force does not replace it")
    if found and not force:
        raise EchogridError(f"{folder}: is not empty (it holds '{found[0]}'); give another folder, or --force to replace a drive")


def _write(
    recording: Recording,
    truth_map: TruthMap | None,
    folder: Path,
    fd: bool,
    messages: list[can.Message],
    wirings: dict[str, Wiring],
    buses: int,
    beside: Callable[[Path], None] | None,
) -> None:
    partial = folder.parent / f".{folder.name}.partial"
    if partial.exists():  # of a run that was killed
        shutil.rmtree(partial)
    partial.mkdir(parents=True)
    try:
        (partial / CONFIG).write_text(config_text(recording, fd, wirings, buses), encoding="utf-8")
        write_log(partial / LOG, messages)
        write_truth(partial / TRUTH, recording, truth_map)
        if beside is not None:
            beside(partial)
        if folder.exists():
            shutil.rmtree(folder)
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_log(path: Path, messages: Iterable[can.Message]) -> None:
    """A gzipped candump log; no time or file name of its own goes into it."""
    with path.open("wb") as file, gzip.GzipFile("", "wb", fileobj=file, mtime=0) as packed:
        text = io.TextIOWrapper(packed, encoding="ascii", newline="\n")
        writer = CanutilsLogWriter(text)
        for message in messages:
            writer.on_message_received(message)
        writer.stop()


def write_truth(path: Path, recording: Recording, truth_map: TruthMap | None = None) -> None:
    """`truth.npz`."""
    truth, turns = recording.truth, recording.lidar
    arrays: dict[str, np.ndarray] = {"stamp_ns": truth.stamp_ns, "x": truth.x, "y": truth.y, "yaw": truth.yaw}
    if truth.walls is not None:
        arrays["walls"] = truth.walls
    if truth_map is not None:
        arrays |= {"log_odds": truth_map.log_odds, "origin": np.array(truth_map.origin), "cell": np.array(truth_map.cell)}
    if turns is not None:
        centimetres = np.where(np.isfinite(turns.ranges), np.rint(turns.ranges * 100), 0)
        arrays |= {"lidar_stamp_ns": turns.stamp_ns, "lidar_cm": centimetres.astype(np.uint16)}
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]  # numpy's stub takes the keywords for allow_pickle


def config_text(recording: Recording, fd: bool, wirings: dict[str, Wiring], buses: int) -> str:
    """The drive's `echogrid.toml`."""
    layout, body = RadarLayout(fd), recording.body
    rates = f"fd = true\nbitrate = {BITRATE}\ndata_bitrate = {DATA_BITRATE}" if fd else f"fd = false\nbitrate = {BITRATE}"
    parts = [f'vehicle = "{recording.vehicle}"']
    parts += [f'[[bus]]\nname = "can{number}"\nchannel = "can{number}"\n{rates}' for number in range(buses)]
    parts.append('[motion]\nbus = "can0"\nprofile = "vehicle_motion"')
    parts.append(f"[body]  # m\nlength = {body.length:g}\nwidth = {body.width:g}\nrear_overhang = {body.rear_overhang:g}")
    for radar in recording.radars:
        wiring, place = wirings[radar.name], radar.base_from_sensor
        parts.append(
            f'[[radar]]\nname = "{radar.name}"\nbus = "can{wiring.bus}"\n'
            f'profile = "{layout.profile}"\nid_offset = 0x{wiring.id_offset:02X}\n'
            f"x = {place.x:.4g}\ny = {place.y:.4g}\nyaw_deg = {math.degrees(place.yaw):.4f}\nfov_deg = {math.degrees(radar.fov):g}"
        )
    return "\n\n".join(parts) + "\n"
