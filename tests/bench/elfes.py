"""The analytic update, from detections to the map, beside a compiled Elfes of as many rays and beside OctoMap: by turns in one run.

`python -m tests.bench.elfes` prints one line of JSON.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from echogrid.config.loading import load_config
from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.inverse_sensor_model import AnalyticSensorModel, BeamModel
from echogrid.core.evidence.raster import Image, rasterize
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.motion.se2 import SE2
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from tests.support.places import ROOT

try:
    import octomap
except ImportError:  # it has wheels for x86-64 only
    octomap = None

SIDE = 2048  # cells of the reference's map
UPDATES, EVERY, TURNS = 40, 10, 15


@numba.njit(cache=False)
def compiled_elfes(points, origins, x, y, yaw, offsets, weights, cell, free, occupied, margin, clamp, grid):  # type: ignore[no-untyped-def]
    """Adds what detections in base say, from a car at this pose, to a (SIDE, SIDE) map of log-odds with the origin in its middle: what any
    robotics library does, with nothing between a beam and the map."""
    cos, sin, middle = math.cos(yaw), math.sin(yaw), grid.shape[0] // 2
    for n in range(len(points)):
        ox = x + cos * origins[n, 0] - sin * origins[n, 1]
        oy = y + sin * origins[n, 0] + cos * origins[n, 1]
        away_x, away_y = points[n, 0] - origins[n, 0], points[n, 1] - origins[n, 1]
        distance, bearing = math.hypot(away_x, away_y), math.atan2(away_y, away_x) + yaw
        for ray in range(len(offsets)):
            dx, dy = math.cos(bearing + offsets[ray]), math.sin(bearing + offsets[ray])
            last_row, last_column, along = -1, -1, cell / 2
            while along < distance - margin:
                row, column = math.floor((oy + along * dy) / cell) + middle, math.floor((ox + along * dx) / cell) + middle
                if row != last_row or column != last_column:
                    grid[row, column] = max(-clamp, min(clamp, grid[row, column] + free * weights[ray]))
                    last_row, last_column = row, column
                along += cell / 2
            row, column = math.floor((oy + distance * dy) / cell) + middle, math.floor((ox + distance * dx) / cell) + middle
            grid[row, column] = max(-clamp, min(clamp, grid[row, column] + occupied * weights[ray]))


def elfes() -> dict[str, Any]:
    """Median µs of processor time of an update, the quartiles over the turns, and the ratio of ours."""
    drive = find_drive(ROOT / "service" / "echogrid" / "demo_drive", None)
    config = load_config(drive.config, "analytic")
    pipeline = Pipeline(config, drive.config)
    mapper, spec, beam = pipeline.mapper, config.grid.spec(), BeamModel()
    seen: list[tuple[np.ndarray, np.ndarray, SE2]] = []
    around: list[Surroundings] = []
    infer, integrate = mapper.infer, mapper.map.integrate

    def noted(surroundings: Surroundings) -> Image:
        around.append(surroundings)
        return infer(surroundings)

    def placed(said: Image, pose: SE2, view: Any) -> None:
        if len(around) % EVERY == 0:
            seen.append((around[-1].now.points, around[-1].now.origins, pose))
        integrate(said, pose, view)

    mapper.infer, mapper.map.integrate = noted, placed  # type: ignore[method-assign]
    for _ in pipeline.updates(Log(drive.log).batches()):
        if len(seen) == UPDATES:
            break
    total, model = OccupancyMap(spec), AnalyticSensorModel(spec, tuple(mapper.mounts.values()))
    grid, tree = np.zeros((SIDE, SIDE), np.float32), None if octomap is None else octomap.OcTree(spec.cell)
    sigmas, weights = beam.spread()
    rays = sigmas * beam.beam_sigma, weights, spec.cell, beam.free, beam.occupied, beam.margin * spec.cell, 3.5, grid

    def ours(points: np.ndarray, origins: np.ndarray, pose: SE2) -> None:
        total.integrate(model(rasterize(points, spec)), pose)

    def numbas(points: np.ndarray, origins: np.ndarray, pose: SE2) -> None:
        compiled_elfes(points, origins, pose.x, pose.y, pose.yaw, *rays)

    def octomaps(points: np.ndarray, origins: np.ndarray, pose: SE2) -> None:
        """One ray a detection, from each radar's place."""
        there, sensors = pose.apply(points), pose.apply(origins)
        for sensor in np.unique(sensors, axis=0):
            some = (sensors == sensor).all(axis=1)
            tree.insertPointCloud(np.pad(there[some], ((0, 0), (0, 1))), np.append(sensor, 0.0))

    works: dict[str, Callable[..., None]] = {"ours": ours, "compiled Elfes, 5 rays": numbas}
    if tree is not None:
        works["octomap, 1 ray"] = octomaps
    times: dict[str, list[float]] = {name: [] for name in works}
    for work in works.values():
        work(*seen[0])  # compiled here
    for _ in range(TURNS):
        for name, work in works.items():
            begun = time.thread_time()
            for update in seen:
                work(*update)
            times[name].append((time.thread_time() - begun) / len(seen) * 1e6)
    found: dict[str, Any] = {"detections": round(statistics.mean(len(points) for points, _, _ in seen), 1)}
    for name, spent in times.items():
        low, middle, high = statistics.quantiles(spent, n=4)
        ratio = statistics.median(one / other for one, other in zip(times["ours"], spent, strict=True))
        found[name] = {"us": round(middle, 1), "quartiles_us": [round(low, 1), round(high, 1)], "ours_against_it": round(ratio, 2)}
    return found


if __name__ == "__main__":
    print(json.dumps(elfes()))
