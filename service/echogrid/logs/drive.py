"""Drive folders: a recording with its configuration, and the true poses where they are known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from echogrid.core.map.tiled_map import LogOdds
from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid.files import meant

MOST_BYTES = 1 << 30  # that a truth file unpacks to
ENDINGS = (".log", ".blf", ".asc", ".mf4", ".trc", ".mcap", ".csv", ".pcap", ".pcapng", ".db")
FRAMES_ALONE = tuple(ending for ending in ENDINGS if ending not in (".csv", ".db"))  # what else has these is no recording
LOGS = tuple(f"can{ending}{packing}" for ending in ENDINGS for packing in (".gz", ".zst", ""))


@dataclass(frozen=True, slots=True, eq=False)
class TrueMap:
    """The map that a simulated drive should give, in the frame of the first true pose."""

    log_odds: LogOdds  # (H, W), rows along y, columns along x
    origin: tuple[float, float]  # m: x and y of the corner of cell [0, 0]


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True poses of base, from the first one on: stamp_ns (N,) int64, poses (N, 3) x, y (m) and yaw (rad).

    `map` is None where it is not known.
    """

    stamp_ns: np.ndarray
    poses: Floats
    map: TrueMap | None


@dataclass(frozen=True, slots=True)
class Drive:
    """Where a recording and its configuration are; `truth` may not exist."""

    config: Path
    log: Path
    truth: Path


def find_drive(path: Path, config: Path | None) -> Drive:
    """A drive folder, or a log with a configuration of its own. Raises EchogridError where either is missing."""
    if not path.exists():
        raise EchogridError(f"{path}: there is no such file or folder{meant(path)}")
    if not path.is_dir():
        if config is None and path.suffix == ".toml":
            raise EchogridError(f"{path}: is no recording: give a configuration with -c, and a recording before it")
        if config is None:
            raise EchogridError(f"{path}: a log needs a configuration: give it with -c, or name a drive folder")
        return Drive(config, path, path.parent / "truth.npz")
    log = next((path / name for name in LOGS if (path / name).is_file()), None)
    if log is None:
        wanted = f"{path}: holds no recording, expected one of can.log.gz, {', '.join(f'can{ending}' for ending in ENDINGS)}"
        other = first_recording(path)
        raise EchogridError(wanted if other is None else f"{wanted}; {other} is taken by its own name, with -c")
    if config is None and not (path / "echogrid.toml").is_file():
        raise EchogridError(f"{path}: holds {log.name} and no echogrid.toml: give a configuration with -c")
    return Drive(config or path / "echogrid.toml", log, path / "truth.npz")


def first_recording(folder: Path) -> Path | None:
    """The first file by name that can be nothing but a recording, None where the folder has none or is closed to us."""
    try:
        return next((one for one in sorted(folder.iterdir()) if one.name.lower().removesuffix(".gz").endswith(FRAMES_ALONE)), None)
    except OSError:
        return None


def load_truth(path: Path) -> Truth | None:
    """The true poses, or None where the drive has none. Raises EchogridError for a file that is something else."""
    if not path.is_file():
        return None
    try:
        with ZipFile(path) as packed:
            unpacked = sum(entry.file_size for entry in packed.infolist())
        if unpacked > MOST_BYTES:
            raise ValueError(f"it unpacks to {unpacked >> 20} MiB")
        with np.load(path, allow_pickle=False) as file:
            stamp_ns, columns = file["stamp_ns"].astype(np.int64), [file[key].astype(float) for key in ("x", "y", "yaw")]
            if stamp_ns.ndim != 1 or any(column.shape != stamp_ns.shape for column in columns):
                raise ValueError("their lengths differ")
            if not len(stamp_ns) or not np.isfinite(columns).all() or (np.diff(stamp_ns) < 0).any():
                raise ValueError("expected at least one pose, finite numbers, and times that do not go back")
            known = None
            if "log_odds" in file:
                x, y = map(float, file["origin"])
                known = TrueMap(file["log_odds"].astype(np.float32), (x, y))
                if known.log_odds.ndim != 2:
                    raise ValueError("the map log_odds is not two-dimensional")
            return Truth(stamp_ns, np.stack(columns, axis=1), known)
    except Exception as error:  # zipfile, zlib and numpy raise what garbage makes them stumble over
        raise EchogridError(f"{path}: is not a truth file with the arrays stamp_ns, x, y and yaw: {error}") from error
