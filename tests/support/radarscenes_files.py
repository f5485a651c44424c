"""RadarScenes' files for tests: a sequence made here, written in both layouts."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

MOUNTS = {1: (3.663, -0.873, -1.484), 2: (3.86, -0.7, -0.436), 3: (3.86, 0.7, 0.436), 4: (3.663, 0.873, 1.484)}
OFFICIAL_US = 156_862_647_501  # the official clock's start
RADAR = np.dtype(
    [("timestamp", "<i8"), ("sensor_id", "u1")]
    + [(name, "<f4") for name in ("range_sc", "azimuth_sc", "rcs", "vr", "vr_compensated", "x_cc", "y_cc", "x_seq", "y_seq")]
    + [("uuid", "S32"), ("track_id", "S32"), ("label_id", "u1")]
)
ODOMETRY = np.dtype([("timestamp", "<i8")] + [(name, "<f4") for name in ("x_seq", "y_seq", "yaw_seq", "vx", "yaw_rate")])


@dataclass
class Made:
    scans: list[tuple[int, int, np.ndarray]]  # sensor, µs, (N, 4) float32 range, azimuth, range rate, RCS
    odometry_us: np.ndarray
    odometry: np.ndarray  # (N, 5) float32


def write_compact(made: Made, path: Path) -> Path:
    arrays: dict[str, Any] = {"mount_x_y_yaw": np.array([MOUNTS[sensor] for sensor in (1, 2, 3, 4)])}
    for sensor in (1, 2, 3, 4):
        mine = [(index, stamp, rows) for index, (of, stamp, rows) in enumerate(made.scans) if of == sensor]
        rows = np.concatenate([rows for _, _, rows in mine])
        arrays[f"radar{sensor}_det"] = np.concatenate((rows, np.zeros((len(rows), 6), dtype=np.float32)), axis=1)
        arrays[f"radar{sensor}_off"] = np.cumsum([0, *(len(rows) for _, _, rows in mine)])
        arrays[f"radar{sensor}_odom"] = np.array(
            [[stamp / 1e6, made.odometry_us[index] / 1e6, *made.odometry[index].tolist()] for index, stamp, _ in mine]
        )
    np.savez(path, **arrays)
    return path


def write_official(made: Made, folder: Path) -> Path:
    folder.mkdir(parents=True)
    radar = np.zeros(sum(len(rows) for _, _, rows in made.scans), dtype=RADAR)
    at = 0
    for sensor, stamp, rows in sorted(made.scans, key=lambda scan: scan[1]):
        part = radar[at : at + len(rows)]
        part["timestamp"], part["sensor_id"] = OFFICIAL_US + stamp, sensor
        part["range_sc"], part["azimuth_sc"], part["vr"], part["rcs"] = rows.T
        part["vr_compensated"] = 7.0
        at += len(rows)
    odometry = np.zeros(len(made.odometry), dtype=ODOMETRY)
    odometry["timestamp"] = OFFICIAL_US + made.odometry_us
    for name, column in zip(ODOMETRY.names[1:], made.odometry.T, strict=True):  # type: ignore[index]
        odometry[name] = column
    with h5py.File(folder / "radar_data.h5", "w") as file:
        file["radar_data"], file["odometry"] = radar, odometry
    mounts = {f"radar_{sensor}": {"id": sensor, "x": x, "y": y, "yaw": yaw} for sensor, (x, y, yaw) in MOUNTS.items()}
    (folder.parent / "sensors.json").write_text(json.dumps(mounts))
    return folder
