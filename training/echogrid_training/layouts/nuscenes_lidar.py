"""nuScenes with its lidar: LIDAR_TOP, a 32-beam HDL-32E at 20 Hz, beside the four corner radars and the CAN bus of `drives/nuscenes.py`.

By the data set's schema: a record of sample_data names a file `…/LIDAR_TOP/….pcd.bin` of float32 x, y, z, intensity, ring of each point in
the sensor's frame (x right, y ahead, z up); its calibrated_sensor says where that is in the ego frame, which is base: translation (m) and
rotation (quaternion w, x, y, z). Clouds are not freed of the car's motion during a turn; the stamp (µs) is of its end.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid.errors import EchogridError
from echogrid.files import meant
from echogrid_training.drives import nuscenes
from echogrid_training.labelling.clouds import Cloud
from echogrid_training.labelling.lidar_mount import Pose3
from echogrid_training.layouts.with_lidar import Brought
from echogrid_training.recording import Track, untracked

CHANNEL = "LIDAR_TOP"
FIELDS = 5
HALF_A_TURN_MS = 25.0


def load(root: Path, scene: str | None, track: Track = untracked) -> Brought:
    """One scene of the official layout. Raises EchogridError."""
    if not root.is_dir():
        raise EchogridError(f"{root}: there is no such folder; expected nuScenes' official layout{meant(root)}")
    if not any(root.glob("v1.0-*")):
        raise EchogridError(f"{root}: holds no v1.0-* tables; the lidar is in the official layout alone")
    _, tables, token = nuscenes.official_scene(root, scene)
    (clouds,) = nuscenes.clouds_of(tables, token, [CHANNEL])
    recording = nuscenes.load(root, scene, track)
    files = track(list(zip(clouds.stamp_us.tolist(), clouds.files, strict=True)), f"reading {CHANNEL}")
    turns = [Cloud(1000 * stamp_us, _points(root / file)) for stamp_us, file in files]
    return Brought(recording, turns, Pose3(rotation(clouds.mount[3:]), clouds.mount[:3]), HALF_A_TURN_MS)


def rotation(quaternion: Floats) -> Floats:
    """(3, 3) of w, x, y, z."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.array(rows)


def _points(path: Path) -> Floats:
    try:
        raw = np.fromfile(path, dtype="<f4")
    except FileNotFoundError:
        raise EchogridError(f"{path}: there is no such file") from None
    if len(raw) % FIELDS:
        raise EchogridError(f"{path}: holds {len(raw)} numbers, expected {FIELDS} for each point: x, y, z, intensity, ring")
    points: Floats = raw.reshape(-1, FIELDS)[:, :3].astype(float)
    return points[np.isfinite(points).all(axis=1)]
