"""A map and its drive as files: npz, ROS map_server (pgm + yaml), picture, trajectory."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from echogrid.core.map.tiled_map import LogOdds, TiledMap
from echogrid.core.motion.odometry import EgoState
from echogrid.maps import map_server
from echogrid.maps.dense_map import write_npz
from echogrid.maps.picture import draw


def write_map(folder: Path, occupancy: TiledMap, trajectory: Sequence[EgoState]) -> tuple[str, list[str]]:
    """Writes map.npz and trajectory.csv, and, where anything was mapped, map.pgm, map.yaml and map.png.

    Returns the map's SHA-256, and the names of the files that were written.
    """
    written = ["map.npz", "trajectory.csv"]
    row, column, log_odds = occupancy.whole()
    cell = occupancy.spec.cell
    origin = (column * cell, row * cell)
    write_npz(folder / "map.npz", {"log_odds": log_odds, "origin": np.array(origin), "cell": np.array(cell)})
    driven = np.array([(ego.odom_from_base.x, ego.odom_from_base.y) for ego in trajectory]).reshape(-1, 2)
    if log_odds.size:
        map_server.write(folder / "map.yaml", map_server.pixels_of(log_odds, "trinary"), origin, cell, "trinary")
        # Level 3 makes these pictures smaller than 6 does, in half the time.
        draw(log_odds, origin, cell, driven).save(folder / "map.png", compress_level=3)
        written += ["map.pgm", "map.yaml", "map.png"]
    with (folder / "trajectory.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("stamp_ns", "x", "y", "yaw"))
        for ego in trajectory:
            pose = ego.odom_from_base
            writer.writerow((ego.stamp_ns, f"{pose.x:.6f}", f"{pose.y:.6f}", f"{pose.yaw:.8f}"))
    return sha256(log_odds, origin, cell), written


def sha256(log_odds: LogOdds, origin: tuple[float, float], cell: float) -> str:
    """Of the map's shape, place and every cell."""
    digest = hashlib.sha256()
    digest.update(np.array((*log_odds.shape, *origin, cell), dtype="<f8").tobytes())
    digest.update(log_odds.astype("<f4").tobytes())
    return digest.hexdigest()
