"""Astyx' files for tests: frames of noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np


def cloud(seed: int, count: int = 4000) -> np.ndarray:
    """(N, 3) m: walls ahead, ground, and a roof."""
    rng = np.random.default_rng(seed)
    bearing, distance = rng.uniform(-2, 2, count), rng.uniform(1, 40, count)
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), rng.uniform(-2, 2, count)), axis=-1)


def reflections(seed: int, count: int = 200) -> np.ndarray:
    """(N, 5) x, y, z, range rate, magnitude."""
    rng = np.random.default_rng(seed)
    bearing, distance = rng.uniform(-1.2, 1.2, count), rng.uniform(0.5, 60, count)
    return np.stack((distance * np.cos(bearing), distance * np.sin(bearing), *rng.uniform(-3, 3, (2, count)), rng.permutation(count)), -1)


def write_file(path: Path, **changes: Any) -> Path:
    """Two frames."""
    radar, points = reflections(1, 90), cloud(2, 500)
    arrays = {
        "radar_xyz_vr_mag": radar.astype(np.float32),
        "radar_off": np.array((0, 40, 90)),
        "lidar_xyz_5mm_in_radar_frame": np.round(points / 0.005).astype(np.int16),
        "lidar_off": np.array((0, 200, 500)),
    }
    np.savez(path, **(arrays | changes))
    return path
