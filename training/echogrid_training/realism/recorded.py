"""The same figures of recordings: RadarScenes' labels, Astyx' radar beside its lidar, KITTI's lidar as a true map. Compact files."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.drives.radarscenes import SENSORS
from echogrid_training.realism.figures import surface_distance
from echogrid_training.recording import Recording
from echogrid_training.sensors import lidar
from echogrid_training.sources import load_npz
from echogrid_training.truth.ground_truth import TruthBuilder, TruthMap

STATIC = 11  # RadarScenes' label of what stands
STRONGEST = 64  # of Astyx' 2,000 points, to resemble a series radar
ASTYX_HEIGHTS = (-1.0, 1.2)  # m about the radar: neither ground nor overhead
VELODYNE_HEIGHT, KITTI_GROUND, KITTI_ROOF = 1.73, 0.3, 1.8  # m


def standing(path: Path, recording: Recording) -> list[NDArray[np.bool_]]:
    """Per scan, in order of time, of a recording made of this compact RadarScenes file: which detections are labelled as static."""
    arrays = load_npz(path, [f"radar{sensor}_{part}" for sensor in SENSORS for part in ("det", "off")])
    labels = {}
    for radar, sensor in zip(recording.radars, SENSORS, strict=True):
        rows, offsets = arrays[f"radar{sensor}_det"], arrays[f"radar{sensor}_off"]
        labels[radar.name] = iter([rows[first:last, 9] == STATIC for first, last in pairwise(offsets)])
    return [next(labels[scan.sensor]) for scan in sorted(recording.scans, key=lambda scan: scan.stamp_ns)]


def astyx_distances(path: Path) -> tuple[Floats, Floats]:
    """Range (N,) of each frame's strongest detections, and the distance (N,) m of each to the nearest lidar surface."""
    arrays = load_npz(path, ["radar_xyz_vr_mag", "radar_off", "lidar_xyz_5mm_in_radar_frame", "lidar_off"])
    ranges, distances = [], []
    for frame in range(min(len(arrays["radar_off"]), len(arrays["lidar_off"])) - 1):
        radar = _slice(arrays["radar_xyz_vr_mag"], arrays["radar_off"], frame).astype(np.float64)
        cloud = _slice(arrays["lidar_xyz_5mm_in_radar_frame"], arrays["lidar_off"], frame) * 0.005
        surfaces = cloud[(cloud[:, 2] > ASTYX_HEIGHTS[0]) & (cloud[:, 2] < ASTYX_HEIGHTS[1])][:, :2]
        radar = radar[(radar[:, 2] > ASTYX_HEIGHTS[0]) & (radar[:, 2] < ASTYX_HEIGHTS[1])]
        radar = radar[np.argsort(-radar[:, 4])[:STRONGEST]]
        if len(surfaces) and len(radar):
            ranges.append(np.hypot(radar[:, 0], radar[:, 1]))
            distances.append(surface_distance(radar[:, :2], surfaces))
    return np.concatenate(ranges), np.concatenate(distances)


def kitti_truth(path: Path) -> tuple[TruthMap, list[SE2]]:
    """The true map of the drive by the simulator's own rule from the real lidar, and the poses along it (movers are not excluded)."""
    arrays = load_npz(path, ["xyz_5mm", "offsets", "poses_kissicp"])
    matrices = arrays["poses_kissicp"]
    poses = [SE2(float(m[0, 3]), float(m[1, 3]), math.atan2(m[1, 0], m[0, 0])) for m in matrices]
    places = np.array([(pose.x, pose.y) for pose in poses])
    builder = TruthBuilder(places.min(axis=0), places.max(axis=0))
    for frame, pose in enumerate(poses):
        cloud = _slice(arrays["xyz_5mm"], arrays["offsets"], frame) * 0.005
        height = cloud[:, 2] + VELODYNE_HEIGHT
        cloud = cloud[(height > KITTI_GROUND) & (height < KITTI_ROOF)]
        bearing = np.arctan2(cloud[:, 1], cloud[:, 0]) + pose.yaw
        ray = np.round(bearing * (lidar.AZIMUTHS / (2 * np.pi))).astype(np.intp) % lidar.AZIMUTHS
        ranges = np.full(lidar.AZIMUTHS, np.inf)
        np.minimum.at(ranges, ray, np.hypot(cloud[:, 0], cloud[:, 1]))
        builder.add(places[frame], ranges, np.zeros(lidar.AZIMUTHS, dtype=np.bool_))
    return builder.finish(), poses


def occupied_share(truth: TruthMap, poses: list[SE2]) -> float:
    """Mean share of occupied pixels among all of the patches at the poses."""
    spec = GridSpec()
    return float(np.mean([np.mean(truth.patch(pose, spec) > 0) for pose in poses]))


def _slice(rows: NDArray[Any], offsets: NDArray[np.int64], index: int) -> NDArray[Any]:
    return rows[offsets[index] : offsets[index + 1]]
