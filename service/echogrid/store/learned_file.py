"""What a car's motion sensors and mounts are off by, kept between drives: a small file beside the map."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from echogrid.config.tables import Config
from echogrid.core.motion.error_filter import Kept
from echogrid.errors import EchogridError
from echogrid.files import read, whole

LEARNED = ".learned.json"
VERSION = 1
MOST_BYTES = 1 << 20


class Document(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`car`: what of the configuration the values refer to; with another they mean nothing."""

    version: int
    car: str
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]


def car_of(config: Config) -> str:
    """Mounts and motion as configured, as text."""
    mounts = [(radar.name, radar.profile, radar.x, radar.y, radar.yaw_deg) for radar in config.radar]
    motion = config.motion
    sensors = (motion.profile, motion.wheel_radius, motion.wheel_scale, motion.yaw_rate_bias_deg_s)
    return msgspec.json.encode((config.vehicle, sensors, mounts)).decode()


def keep(path: Path, car: str, kept: Kept) -> None:
    """Writes the file, or leaves the old one. Raises EchogridError."""
    rows = tuple(tuple(row) for row in kept.covariance.tolist())
    document = Document(VERSION, car, tuple(kept.mean.tolist()), rows)
    try:
        with whole(path) as partial:
            partial.write_bytes(msgspec.json.encode(document) + b"\n")
    except OSError as error:
        raise EchogridError(f"{path}: what was learned of the car cannot be written: {error.strerror}") from error


def recall(path: Path, car: str, size: int) -> Kept | None:
    """`size` errors; None where there is no file, or one of another configuration. Raises EchogridError where it is something else."""
    try:
        if not path.exists():
            return None
        document = msgspec.json.decode(read(path, MOST_BYTES), type=Document)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise EchogridError(f"{path}: is not what echogrid learned of a car: {error}; move it away") from error
    except OSError as error:  # where it cannot even be looked for
        raise EchogridError(f"{path}: cannot be read: {error.strerror}") from error
    if document.version != VERSION or document.car != car:
        return None
    rows = document.covariance
    square = len(document.mean) == len(rows) == size and all(len(row) == size for row in rows)
    if not square:
        raise EchogridError(f"{path}: {len(document.mean)} errors found, expected {size}; move it away")
    mean, covariance = np.array(document.mean), np.array(rows)
    sound = np.isfinite(mean).all() and np.isfinite(covariance).all() and np.allclose(covariance, covariance.T)
    if not sound or np.linalg.eigvalsh(covariance).min() <= 0.0:
        raise EchogridError(f"{path}: holds a covariance that is none; move it away")
    return Kept(mean, covariance)
