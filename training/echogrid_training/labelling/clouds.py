"""A lidar's recording, turn by turn: an MCAP file or a bag of ROS 2 with PointCloud2, or a folder of files named by their stamp."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid_training.drives.pcd import load_pcd
from echogrid_training.labelling import bag
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
    bags = bag.files(source)
    if bags:
        for stamp_ns, _, points in bag.messages(bags, CLOUD, topic, "--topic", decode_cloud):
            yield Cloud(stamp_ns, points)
        return
    if source.is_file():
        raise EchogridError(f"{source}: expected an .mcap file, or a folder: a bag of ROS 2 with one, or files {', '.join(FILES)}")
    found = sorted((path for path in source.iterdir() if path.suffix in FILES), key=_stamp)
    if not found:
        raise EchogridError(
            f"{source}: holds neither .mcap nor {', '.join(FILES)} files, found {some(sorted(p.name for p in source.iterdir()))}"
        )
    for path in found:
        yield Cloud(_stamp(path), points_of(path))


def _stamp(path: Path) -> int:
    if not path.stem.isdecimal():
        raise EchogridError(
            f"{path}: expected a name that is the turn's stamp in ns on the CAN log's clock, such as 1600000000000000000{path.suffix}"
        )
    return int(path.stem)


def points_of(path: Path) -> Floats:
    """(N, 3) m of one file. Raises EchogridError."""
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
