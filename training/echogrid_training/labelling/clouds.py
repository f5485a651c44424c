"""A lidar's recording, turn by turn: an MCAP file or a bag of ROS 2 with PointCloud2, or a folder of files named by their stamp."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid_training.drives.pcd import load_pcd
from echogrid_training.labelling.point_cloud2 import decode_cloud
from echogrid_training.sources import load_npz, some

CLOUD = "sensor_msgs/msg/PointCloud2"
FILES = (".npz", ".pcd", ".bin")
KITTI = 4  # float32 of each point in a .bin file: x, y, z, intensity


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """One turn in the lidar's frame."""

    stamp_ns: int
    points: Floats  # (N, 3) m


def clouds(source: Path, topic: str | None) -> Iterator[Cloud]:
    """In the source's order. `topic` where a bag has several clouds. Raises EchogridError."""
    if not source.exists():
        raise EchogridError(f"{source}: there is no such file or folder with a lidar's recording")
    if source.is_file():
        if source.suffix != ".mcap":
            raise EchogridError(f"{source}: expected an .mcap file, or a folder: a bag of ROS 2 with one, or files {', '.join(FILES)}")
        yield from _mcap([source], topic)
        return
    bags = sorted(source.glob("*.mcap"))
    if bags:
        yield from _mcap(bags, topic)
        return
    if any(source.glob("*.db3")):
        raise EchogridError(f"{source}: is a bag in SQLite; make an MCAP of it with: ros2 bag convert")
    found = sorted((path for path in source.iterdir() if path.suffix in FILES), key=_stamp)
    if not found:
        raise EchogridError(
            f"{source}: holds neither .mcap nor {', '.join(FILES)} files, found {some(sorted(p.name for p in source.iterdir()))}"
        )
    for path in found:
        yield Cloud(_stamp(path), _points(path))


def _stamp(path: Path) -> int:
    if not path.stem.isdecimal():
        raise EchogridError(
            f"{path}: expected a name that is the turn's stamp in ns on the CAN log's clock, such as 1600000000000000000{path.suffix}"
        )
    return int(path.stem)


def _points(path: Path) -> Floats:
    if path.suffix == ".npz":
        points = load_npz(path, ("xyz",))["xyz"].astype(float)
    elif path.suffix == ".pcd":
        points = load_pcd(path, ("x", "y", "z"))
    else:
        raw = np.fromfile(path, dtype="<f4")
        if len(raw) % KITTI:
            raise EchogridError(f"{path}: holds {len(raw)} numbers, expected {KITTI} for each point: x, y, z, intensity")
        points = raw.reshape(-1, KITTI)[:, :3].astype(float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise EchogridError(f"{path}: has points of shape {points.shape}, expected (N, 3)")
    kept: Floats = points[np.isfinite(points).all(axis=1)]
    return kept


def _mcap(files: list[Path], topic: str | None) -> Iterator[Cloud]:
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
    except ImportError as error:
        raise EchogridError(f"{files[0]}: mcap is not installed: pip install mcap") from error

    for path in files:
        with path.open("rb") as file:
            try:
                reader = make_reader(file)
                wanted = _topic(path, reader.get_summary(), topic)
                for _, channel, message in reader.iter_messages(topics=[wanted]):
                    if channel.message_encoding != "cdr":
                        raise ValueError(f"its clouds are encoded as {channel.message_encoding}, expected cdr")
                    stamp_ns, _, points = decode_cloud(message.data)
                    yield Cloud(stamp_ns, points)
            except (McapError, ValueError, KeyError, EOFError, struct.error, zlib.error) as error:
                raise EchogridError(f"{path}: cannot be read as a lidar's recording: {error}") from error


def _topic(path: Path, summary: object, topic: str | None) -> str:
    channels = [] if summary is None else list(summary.channels.values())  # type: ignore[attr-defined]
    schemas = {} if summary is None else summary.schemas  # type: ignore[attr-defined]
    kinds = {one.topic: schemas[one.schema_id].name if one.schema_id in schemas else "no type" for one in channels}
    fitting = sorted(name for name, kind in kinds.items() if kind == CLOUD)
    if topic is not None and topic not in fitting:
        raise EchogridError(f"{path}: has no topic {topic} of type {CLOUD}, found {some(fitting)}")
    if topic is None and len(fitting) != 1:
        known = some(f"{name} ({kind})" for name, kind in sorted(kinds.items()))
        hint = "give one with --topic" if fitting else f"expected one of type {CLOUD}"
        raise EchogridError(f"{path}: has {len(fitting)} topics with clouds: {hint}; its topics are {known}")
    return topic or fitting[0]
