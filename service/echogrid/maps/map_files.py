"""A map and its drive as files: npz, ROS map_server (pgm + yaml), picture, trajectory."""

from __future__ import annotations

import csv
import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map.tiled_map import LogOdds, TiledMap
from echogrid.core.messages import Floats
from echogrid.files import whole
from echogrid.maps import map_server
from echogrid.maps.dense_map import MOST_CELLS, write_npz
from echogrid.maps.picture import draw, save

FILES = ("trajectory.csv", "map.npz", "map.pgm", "map.yaml", "map.png")


def too_wide(occupancy: TiledMap) -> str | None:
    """What to say of a map that one rectangle of cells cannot hold; None where it can."""
    height, width = occupancy.bounds()[2:]
    if height * width <= MOST_CELLS:
        return None
    km = occupancy.spec.cell / 1e3
    return (
        f"the map reaches over {width * km:.1f} x {height * km:.1f} km, more than the {MOST_CELLS >> 20} Mi cells of map.npz and pictures:"
        " they are not written; --store FILE.egmap keeps it, echogrid map show draws it, and map export cuts it"
    )


def write_map(folder: Path, occupancy: TiledMap, stamps_ns: NDArray[np.int64], poses: Floats) -> tuple[str | None, list[str]]:
    """Writes trajectory.csv, map.npz where the map is not `too_wide`, and, where anything was mapped, map.pgm, map.yaml and map.png.

    `stamps_ns` (N,) and `poses` (N, 3), x, y and yaw in odom: where the car was.
    Returns the map's SHA-256 (None where it was not written), and the names of the files that were written.
    """
    with whole(folder / "trajectory.csv") as partial, partial.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("stamp_ns", "x", "y", "yaw"))
        for stamp_ns, (x, y, yaw) in zip(stamps_ns, poses, strict=True):
            writer.writerow((stamp_ns, f"{x:.6f}", f"{y:.6f}", f"{yaw:.8f}"))
    written = ["trajectory.csv"]
    if too_wide(occupancy) is not None:
        return None, written
    row, column, log_odds = occupancy.whole()
    cell = occupancy.spec.cell
    origin = (column * cell, row * cell)
    write_npz(folder / "map.npz", {"log_odds": log_odds, "origin": np.array(origin), "cell": np.array(cell)})
    written.append("map.npz")
    if log_odds.size:
        map_server.write(folder / "map.yaml", map_server.pixels_of(log_odds, "trinary"), origin, cell, "trinary")
        # Level 3 makes these pictures smaller than 6 does, in half the time.
        save(draw(log_odds, origin, cell, poses[:, :2]), folder / "map.png", compress_level=3)
        written += ["map.pgm", "map.yaml", "map.png"]
    return sha256(log_odds, origin, cell), written


def sha256(log_odds: LogOdds, origin: tuple[float, float], cell: float) -> str:
    """Of the map's shape, place and every cell."""
    digest = hashlib.sha256()
    digest.update(np.array((*log_odds.shape, *origin, cell), dtype="<f8").tobytes())
    digest.update(log_odds.astype("<f4").tobytes())
    return digest.hexdigest()
