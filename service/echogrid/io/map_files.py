"""A map and its drive as files: npz, ROS map_server (pgm + yaml), picture, trajectory."""

from __future__ import annotations

import csv
import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from echogrid.core.odometry import EgoState
from echogrid.core.tiled_map import LogOdds, TiledMap, probability
from echogrid.io.picture import draw

# ROS map_server, trinary: grey levels and the probabilities beyond which a cell counts as occupied or free.
OCCUPIED, FREE, UNKNOWN = 0, 254, 205
OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.196


def write_map(folder: Path, occupancy: TiledMap, trajectory: Sequence[EgoState]) -> str:
    """Writes map.npz, map.pgm, map.yaml, map.png and trajectory.csv; returns the map's SHA-256."""
    row, column, log_odds = occupancy.whole()
    cell = occupancy.spec.cell
    origin = (column * cell, row * cell)
    write_npz(folder / "map.npz", log_odds, origin, cell)
    _write_map_server(folder, log_odds, origin, cell)
    driven = np.array([(ego.odom_from_base.x, ego.odom_from_base.y) for ego in trajectory]).reshape(-1, 2)
    if log_odds.size:
        draw(log_odds, origin, cell, driven).save(folder / "map.png")
    with (folder / "trajectory.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("stamp_ns", "x", "y", "yaw"))
        for ego in trajectory:
            pose = ego.odom_from_base
            writer.writerow((ego.stamp_ns, f"{pose.x:.6f}", f"{pose.y:.6f}", f"{pose.yaw:.8f}"))
    return sha256(log_odds, origin, cell)


def write_npz(path: Path, log_odds: LogOdds, origin: tuple[float, float], cell: float) -> None:
    """The map (H, W), the corner (x, y) m of its first cell and the cells' size m: whole and on the disk when it returns, or not at all.

    Raises OSError.
    """
    partial = path.with_name(f".{path.name}.partial")
    with partial.open("wb") as file:
        np.savez_compressed(file, log_odds=log_odds, origin=np.array(origin), cell=np.float64(cell))
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def sha256(log_odds: LogOdds, origin: tuple[float, float], cell: float) -> str:
    """Of the map's shape, place and every cell."""
    digest = hashlib.sha256()
    digest.update(np.array((*log_odds.shape, *origin, cell), dtype="<f8").tobytes())
    digest.update(log_odds.astype("<f4").tobytes())
    return digest.hexdigest()


def _write_map_server(folder: Path, log_odds: LogOdds, origin: tuple[float, float], cell: float) -> None:
    p = probability(log_odds)
    grey = np.full(log_odds.shape, UNKNOWN, dtype=np.uint8)
    grey[(p > OCCUPIED_ABOVE) & (log_odds != 0)] = OCCUPIED
    grey[(p < FREE_BELOW) & (log_odds != 0)] = FREE
    if grey.size:
        Image.fromarray(grey[::-1]).save(folder / "map.pgm")  # the first row of the picture is the largest y
    (folder / "map.yaml").write_text(
        f"image: map.pgm\nmode: trinary\nresolution: {cell}\norigin: [{origin[0]}, {origin[1]}, 0.0]\nnegate: 0\n"
        f"occupied_thresh: {OCCUPIED_ABOVE}\nfree_thresh: {FREE_BELOW}\n"
    )
