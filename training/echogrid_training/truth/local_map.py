"""What the service's map says around the car along a simulated drive, cell by cell beside the truth.

Compared around the car, for that is what a consumer drives by: dead reckoning drifts, and the far end of a long map with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.evidence.raster import GridSpec, Image
from echogrid.core.map.tile import Layers
from echogrid.core.map.tiled_map import TiledMap
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid_training.truth.simulated_truth import load_simulated_truth

EVERY = 5.0  # m of way between two looks at the map


@dataclass(frozen=True, slots=True, eq=False)
class LocalMap:
    """The map's layers (L, H, W) and the true log-odds (H, W; 0: never observed) on the patch of cells around the car."""

    layers: Layers
    truth: Image


def local_maps(folder: Path, model: str, every: float = EVERY) -> Iterator[LocalMap]:
    """Along a simulated drive, mapped by the service with a model as in `--model`. Raises EchogridError."""
    drive = find_drive(folder, None)
    truth = load_simulated_truth(drive.truth)
    config = load_config(drive.config, model)
    pipeline = Pipeline(config, drive.config)
    spec = config.grid.spec()
    last: SE2 | None = None
    for ego in _driven(pipeline, config, drive.log):
        pose = truth.pose(ego.stamp_ns)
        if pose is not None and (last is None or math.hypot(pose.x - last.x, pose.y - last.y) >= every):
            if last is not None:  # at the start there is no map yet
                yield LocalMap(patch(pipeline.mapper.map, ego.odom_from_base, spec), truth.map.patch(pose, spec))
            last = pose


def patch(occupancy: TiledMap, odom_from_base: SE2, spec: GridSpec) -> Layers:
    """(L, H, W): every cell around the car reads the map's cell in which its centre lies."""
    places = odom_from_base.apply(spec.centres().reshape(-1, 2))
    cells = np.floor(places / spec.cell).astype(np.int64)
    column, row = cells.min(axis=0)
    width, height = cells.max(axis=0) - (column, row) + 1
    window = occupancy.window_of_layers(int(row), int(column), int(height), int(width))
    return window[:, cells[:, 1] - row, cells[:, 0] - column].reshape(-1, spec.cells, spec.cells)


def _driven(pipeline: Pipeline, config: Config, log: Path) -> Iterator[EgoState]:
    for update in pipeline.updates(Log(log).batches()):
        yield update.ego
