"""What a network learns from: the radar image that the service draws of a drive's frames, and the true patch at the same place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.config import load_config
from echogrid.core.occupancy import LogOdds
from echogrid.core.raster import Image
from echogrid.core.se2 import SE2
from echogrid.io.drive import find_drive
from echogrid.io.log import Log
from echogrid.io.signals import bus_of
from echogrid.pipeline import Pipeline
from echogrid_training.simulated_truth import load_simulated_truth

SPACING = 0.5  # m: nearer neighbours would say the same


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One map update: `image` is what the service hands to its inverse sensor model, `truth` the log-odds of the true map around the car.

    Where `truth` is 0 nothing was ever observed; ground_truth.ternary and .soft make labels of it.
    """

    stamp_ns: int
    image: Image  # (1, H, W) in [-1, 1]
    truth: LogOdds  # (H, W)
    truth_from_base: SE2


def samples(folder: Path, spacing: float = SPACING) -> Iterator[Sample]:
    """The drive's samples at least `spacing` m of way apart, by the service's own decoding, gate and rasteriser. Raises EchogridError."""
    drive = find_drive(folder, None)
    truth = load_simulated_truth(drive.truth)
    config = load_config(drive.config)
    pipeline = Pipeline(config, drive.config)
    spec = pipeline.mapper.map.spec
    seen: list[Image] = []

    def infer(image: Image) -> Image:
        seen[:] = [image]
        return np.zeros(image.shape[1:], dtype=np.float32)  # no map is made

    pipeline.mapper.infer = infer
    last: SE2 | None = None
    for message in Log(drive.log):
        update = pipeline.add(bus_of(message, config.bus) or "", message)
        pose = None if update is None else truth.pose(update.ego.stamp_ns)
        if update is None or pose is None:
            continue
        if last is None or math.hypot(pose.x - last.x, pose.y - last.y) >= spacing:
            last = pose
            yield Sample(update.ego.stamp_ns, seen[0], truth.map.patch(pose, spec), pose)
