"""What a network learns from: the image that the service draws of a drive's frames, and the true patch at the same place."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.config.loading import load_config
from echogrid.core.evidence.beams import Beams
from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.history_raster import Bytes, HistoryRaster
from echogrid.core.evidence.raster import Image, rasterize
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.tiled_map import LogOdds, View
from echogrid.core.messages import RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid_training.sensors.disturbance import Disturbance
from echogrid_training.truth.earned import earned
from echogrid_training.truth.simulated_truth import load_simulated_truth

SPACING = 1.0  # m: nearer neighbours would say nearly the same


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One map update: `image` is what the service shows its network, `truth` the log-odds of the true map around the car.

    Where `truth` is 0 nothing was ever observed, or, unless it is `whole`, no radar could tell (truth.earned); ground_truth.ternary and
    .soft make labels of it.
    """

    stamp_ns: int
    lidar: Bytes  # (H, W): 1 where the lidar has a return in its newest turn, else 0
    image: Bytes  # (12, H, W), as echogrid.core.evidence.history_raster draws it; where plane 0 is not 0 the paper's image is 1, else -1
    truth: LogOdds  # (H, W)
    truth_from_base: SE2


class Unwritten(LookMap):
    """Takes updates as the default map does, and keeps nothing."""

    def measure(self, beams: Beams, odom_from_base: SE2, view: View) -> None:
        pass

    def integrate(self, said: Image, odom_from_base: SE2, view: View | None = None) -> None:
        pass


def samples(folder: Path, disturbance: Disturbance | None = None, spacing: float = SPACING, whole: bool = False) -> Iterator[Sample]:
    """The drive's samples at least `spacing` m of way apart, by the service's own decoding, gate and rasteriser. Raises EchogridError.

    `whole`: true patches as the paper cuts them, with what no radar can tell.
    """
    drive = find_drive(folder, None)
    truth = load_simulated_truth(drive.truth)
    config = load_config(drive.config, "analytic")  # its sensor model is not run
    pipeline = Pipeline(config, drive.config)
    mapper = pipeline.mapper
    spec = mapper.map.spec
    raster = HistoryRaster(spec, mapper.mounts)
    seen: list[Surroundings] = []

    def infer(around: Surroundings) -> Image:
        seen[:] = [around]
        return Image((0,))  # no map is made

    mapper.map = Unwritten(spec, Calibration())
    mapper.infer = infer
    if disturbance is not None:
        mapper.on_scan = _disturbed(mapper.on_scan, disturbance)  # type: ignore[assignment, method-assign]  # the one way that scans take in
    last: SE2 | None = None
    for update in pipeline.updates(Log(drive.log).batches()):
        pose, newest = truth.pose(update.ego.stamp_ns), seen[-1:]
        seen.clear()
        if pose is None or not newest:
            continue
        if last is None or math.hypot(pose.x - last.x, pose.y - last.y) >= spacing:
            last = pose
            lidar = rasterize(truth.lidar_points(update.ego.stamp_ns, pose), spec)[0] > 0
            patch = truth.map.patch(pose, spec)
            if not whole:
                patch[~earned(patch, newest[0], spec)] = 0.0
            yield Sample(update.ego.stamp_ns, lidar.astype(np.uint8), raster(newest[0]), patch, pose)


def _disturbed(on_scan: Callable[[RadarScan], None], disturbance: Disturbance) -> Callable[[RadarScan], None]:
    def passed(scan: RadarScan) -> None:
        left = disturbance(scan)
        if left is not None:
            on_scan(left)

    return passed
