"""Pictures of a drive: what the service decodes of it, over the truth, as one picture and as a short animation."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.mapper import MapUpdate
from echogrid.core.messages import Floats, RadarScan
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.files import check_folder
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.maps.picture import shade
from echogrid.pipeline import Pipeline
from echogrid_training.sensors import lidar
from echogrid_training.truth.simulated_truth import SimulatedTruth, load_simulated_truth

SPAN, PIXELS = 60.0, 480  # m and pixels of a view's side; up is ahead
STEP_NS, FRAME_MS = 500_000_000, 120
DETECTION, STATIC, LIDAR, CAR, PATH = (206, 60, 60), (240, 150, 20), (60, 130, 220), (20, 110, 60), (226, 88, 34)


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One look at the drive: all detections and the static ones (N, 2) in base since the last look, and the true pose."""

    stamp_ns: int
    detections: Floats
    static: Floats
    truth_from_base: SE2


def inspect(folder: Path, out: Path) -> list[Path]:
    """Writes drive.png and drive.gif; returns their paths. Raises EchogridError if the folder is not a drive with a true map."""
    check_folder(out)
    drive = find_drive(folder, None)
    truth = load_simulated_truth(drive.truth)
    config = load_config(drive.config, "analytic")  # its sensor model is not run
    moments = list(_moments(config, drive.config, drive.log, truth))
    if not moments:
        raise EchogridError(f"{drive.log}: gives no map update within the time of {drive.truth}")
    out.mkdir(parents=True, exist_ok=True)
    views = [view(moment, truth, config) for moment in moments]
    views[0].save(out / "drive.gif", save_all=True, append_images=views[1:], duration=FRAME_MS, loop=0)
    overview(moments, truth).save(out / "drive.png")
    return [out / "drive.png", out / "drive.gif"]


def _moments(config: Config, source: Path, log: Path, truth: SimulatedTruth) -> Iterator[Moment]:
    pipeline = Pipeline(config, source)
    mounts = {radar.name: radar.mount() for radar in config.radar}
    seen: list[Floats] = []
    static: list[Floats] = []
    next_ns = 0
    for now_ns, items in pipeline.signals.heard(Log(log).batches(), config.bus):
        ended = list[MapUpdate]()
        for item in items:
            if isinstance(item, RadarScan):
                in_sensor = np.stack((item.range * np.cos(item.azimuth), item.range * np.sin(item.azimuth)), axis=1)
                seen.append(mounts[item.sensor].base_from_sensor.apply(in_sensor))
            ended += pipeline.mapper.take(item, now_ns)
        update = pipeline.mapper.update(now_ns) or (ended[-1] if ended else None)
        if update is None:
            continue
        static.append(update.static_points)
        pose = truth.pose(update.ego.stamp_ns)
        if update.ego.stamp_ns >= next_ns and pose is not None:
            yield Moment(update.ego.stamp_ns, np.concatenate(seen[-8:]), static[-1], pose)
            next_ns = update.ego.stamp_ns + STEP_NS
            seen, static = [], []


def view(moment: Moment, truth: SimulatedTruth, config: Config) -> Image.Image:
    """The surroundings of the car, ahead is up: the true map, lidar blue, detections red, those that the gate takes for static orange."""
    axis = (np.arange(PIXELS) + 0.5) / PIXELS * SPAN - SPAN / 2
    x, y = np.meshgrid(axis, axis, indexing="ij")  # row i is x, column j is y, both from behind and right
    places = moment.truth_from_base.apply(np.stack((x.ravel(), y.ravel()), axis=1))
    background = truth.map.at(places).reshape(PIXELS, PIXELS)
    image = Image.fromarray(shade(background)[::-1, ::-1])
    pen = ImageDraw.Draw(image)
    turn = truth.lidar_at(moment.stamp_ns)
    bearing, ranges = lidar.bearings()[np.isfinite(turn)] - moment.truth_from_base.yaw, turn[np.isfinite(turn)]
    arm = lidar.BASE_FROM_LIDAR
    _dots(pen, np.stack((ranges * np.cos(bearing) + arm.x, ranges * np.sin(bearing) + arm.y), axis=1), LIDAR, 1)
    _dots(pen, moment.detections, DETECTION, 2)
    _dots(pen, moment.static, STATIC, 2)
    body = config.body
    rear, front, side = -body.rear_overhang, body.length - body.rear_overhang, body.width / 2
    corners = np.array(((rear, -side), (front, -side), (front, side), (rear, side)))
    pen.polygon([tuple(place) for place in _pixels(corners).tolist()], outline=CAR, width=2)
    return image


def overview(moments: list[Moment], truth: SimulatedTruth) -> Image.Image:
    """The whole true map, y up, with the static detections of all looks and the true path."""
    zoom = max(1, 1400 // max(*truth.map.log_odds.shape, 1))
    shaded = Image.fromarray(shade(truth.map.log_odds)[::-1])
    image = shaded.resize((shaded.width * zoom, shaded.height * zoom), Image.Resampling.NEAREST)
    pen = ImageDraw.Draw(image)
    for moment in moments:
        for x, y in (moment.truth_from_base.apply(moment.static) - truth.map.origin).tolist():
            column, row = x / truth.map.cell * zoom, image.height - y / truth.map.cell * zoom
            pen.ellipse((column - 1, row - 1, column + 1, row + 1), fill=STATIC)
    way = np.array([(moment.truth_from_base.x, moment.truth_from_base.y) for moment in moments]) - truth.map.origin
    pen.line([(x / truth.map.cell * zoom, image.height - y / truth.map.cell * zoom) for x, y in way.tolist()], fill=PATH, width=2)
    return image


def _pixels(points: Floats) -> Floats:
    """(N, 2) column and row of points in base: ahead is up, left is left."""
    return (SPAN / 2 - points[:, ::-1]) / SPAN * PIXELS


def _dots(pen: ImageDraw.ImageDraw, points: Floats, colour: tuple[int, int, int], radius: int) -> None:
    for column, row in _pixels(points).tolist():
        if math.isfinite(column) and math.isfinite(row):
            pen.ellipse((column - radius, row - radius, column + radius, row + radius), fill=colour)
