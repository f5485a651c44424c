"""One frame of a front radar beside its lidar (Astyx): average precision of "occupied" over the cells that the lidar observed.

Definitions are the reference scores': of a frame the STRONGEST points, the nearest lidar surface in every 0.4° within ±60°, free before it
and occupied on it. The set has no ego motion: the history holds this one scan, and all of it is taken to stand. Its magnitudes are no radar
cross-sections, so none is reported.

The reference's cells reach from the radar 30 m ahead and 15 m to each side, the service's patch 15 m from base in all directions. So the
radar is placed twice: for the "whole" patch in the middle of its rear edge, where its cells are the reference's, but where no car has a
radar and no network has seen one; for the "near" patch where cars have it, and only cells less than 11.25 m ahead of it are scored.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.beams import Beams
from echogrid.core.evidence.history import Detections, History, Looks, Surroundings
from echogrid.core.evidence.raster import GridSpec, Image, rasterize
from echogrid.core.map.look_map import LookMap
from echogrid.core.map.tile import Layers
from echogrid.core.map.tiled_map import View
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import IDENTITY, SE2
from echogrid.core.radar.mount import Mount
from echogrid.errors import EchogridError
from echogrid.model.network import OnnxSensorModel
from echogrid_training.evaluation.metrics import average_precision
from echogrid_training.evaluation.recorded.elfes import along, once
from echogrid_training.recording import Track, untracked
from echogrid_training.sources import load_npz

STRONGEST, REACH = 64, 30.0  # points of a frame, and m
RADAR_HEIGHTS, LIDAR_HEIGHTS = (-1.0, 1.5), (-1.0, 1.2)  # m about the radar
HALF_FOV = math.radians(60.0)
SECTOR = math.radians(0.4)  # of which the nearest lidar point counts
BLIND = 2.0  # m around the radar: what the lidar sees there is the car
PLACES = {"whole": SE2(-15.0, 0.0, 0.0), "near": SE2(3.75, 0.0, 0.0)}  # base_from_sensor, both on corners of cells
ELFES_FREE, ELFES_HIT, ELFES_BESIDE = -0.1, 0.3, 0.15  # log-odds of the reference's model: on each of five rays, at and about their ends
ELFES_RAYS = np.deg2rad(np.linspace(-2, 2, 5))
RADAR = "front"


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """In the radar's frame, x along boresight, y left, m."""

    radar: Floats  # (N, 2), the strongest points
    lidar: Floats  # (M, 2), obstacles


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """One frame with the radar at a place: what is true, and what each method makes of the cells, all (H, W)."""

    label: Image  # 1 occupied, 0 free, -1 not observed
    scores: dict[str, Image]  # by method


@dataclass(frozen=True, slots=True)
class FrameScores:
    name: str
    place: str
    frames: int
    cells: int  # observed ones of all frames
    occupied: float  # share of them
    average_precision: dict[str, float]  # by method


def load(path: Path) -> list[Frame]:
    """Of a compact file. Raises EchogridError."""
    arrays = load_npz(path, ["radar_xyz_vr_mag", "radar_off", "lidar_xyz_5mm_in_radar_frame", "lidar_off"])
    radar, cloud = arrays["radar_xyz_vr_mag"], arrays["lidar_xyz_5mm_in_radar_frame"]
    if radar.shape[1:] != (5,) or cloud.shape[1:] != (3,):
        raise EchogridError(
            f"{path}: radar_xyz_vr_mag and lidar_xyz_5mm_in_radar_frame have the shapes {radar.shape} and {cloud.shape}, "
            "expected 5 and 3 columns"
        )
    offsets, turns = arrays["radar_off"], arrays["lidar_off"]
    if len(offsets) != len(turns) or len(offsets) < 2 or offsets[-1] != len(radar) or turns[-1] != len(cloud):
        raise EchogridError(f"{path}: the lengths of radar_off, lidar_off and their arrays do not fit together")
    scans = np.split(radar.astype(float), offsets[1:-1])
    return [Frame(strongest(scan), obstacles(turn * 0.005)) for scan, turn in zip(scans, np.split(cloud, turns[1:-1]), strict=True)]


def strongest(scan: Floats) -> Floats:
    """(N, 5) x, y, z, range rate, magnitude -> (n, 2) m, at most STRONGEST within REACH and neither on the ground nor overhead."""
    low, high = RADAR_HEIGHTS
    near = scan[(np.hypot(scan[:, 0], scan[:, 1]) < REACH) & (scan[:, 2] > low) & (scan[:, 2] < high)]
    points: Floats = near[np.argsort(-near[:, 4], kind="stable")[:STRONGEST], :2]
    return points


def obstacles(cloud: Floats) -> Floats:
    """(M, 3) m -> (m, 2): the nearest point of each SECTOR ahead."""
    low, high = LIDAR_HEIGHTS
    distance = np.hypot(cloud[:, 0], cloud[:, 1])
    kept = (cloud[:, 2] > low) & (cloud[:, 2] < high) & (distance > BLIND)
    points, distance = cloud[kept, :2], distance[kept]
    bearing = np.arctan2(points[:, 1], points[:, 0])
    sector = np.floor((bearing + math.pi) / SECTOR)
    order = np.lexsort((distance, sector))
    nearest = order[np.diff(sector[order], prepend=-1) != 0]
    ahead: Floats = points[nearest[np.abs(bearing[nearest]) <= HALF_FOV]]
    return ahead


class Judge:
    """Callable: a frame -> what is true and what the methods say, with the radar at one place."""

    def __init__(self, model: str, place: str) -> None:
        """`model`: a file's path; `place`: one of PLACES. Raises EchogridError."""
        self.place = place
        self.spec = GridSpec()
        self.base_from_sensor = PLACES[place]
        self.mount = Mount(self.base_from_sensor, HALF_FOV, REACH)
        self.network = OnnxSensorModel(Path(model), self.spec, {RADAR: self.mount})

    def __call__(self, frame: Frame) -> Judged:
        """The network alone, and what the map reads after one look."""
        drawn = rasterize(self.base_from_sensor.apply(frame.radar), self.spec)
        log_odds, weight = self.network(self.around(frame))
        layers = self.measured(frame)
        layers[:2] = log_odds * weight, weight
        scores = {
            "elfes": elfes(frame.radar, self.base_from_sensor, self.spec),
            "learned": log_odds,
            "looks": LookMap(self.spec, self.network.contract.calibration).read(layers),
            "detections": drawn[0],
            "distance": self.spec.centres()[..., 0],
        }
        return Judged(label(frame.lidar, self.base_from_sensor, self.spec), scores)

    def measured(self, frame: Frame) -> Layers:
        """(5, H, W): the layers of a map that this one frame was measured for, and no network asked."""
        occupancy = LookMap(self.spec, self.network.contract.calibration)
        points = self.base_from_sensor.apply(frame.radar)
        origins = np.broadcast_to((self.base_from_sensor.x, self.base_from_sensor.y), points.shape)
        nobody = np.zeros((self.spec.cells, self.spec.cells), np.uint16)
        occupancy.takes(IDENTITY)
        occupancy.measure(Beams(points, origins, np.ones(len(points), np.uint16)), IDENTITY, View(0, nobody))
        half = self.spec.cells // 2
        return occupancy.window_of_layers(-half, -half, self.spec.cells, self.spec.cells)

    def around(self, frame: Frame) -> Surroundings:
        """As the service would draw it after its first scan."""
        points = self.base_from_sensor.apply(frame.radar)
        origins = np.broadcast_to((self.base_from_sensor.x, self.base_from_sensor.y), points.shape)
        detections = Detections(points, origins, np.full(len(points), np.nan), np.zeros(len(points)))
        history = History()
        history.add(detections, Looks.of([self.mount], [IDENTITY]), 0.0)
        return history.surroundings(IDENTITY, [RADAR])


def label(lidar: Floats, base_from_sensor: SE2, spec: GridSpec) -> Image:
    """(H, W): 1 occupied, 0 free, -1 not observed, for obstacles (M, 2) m in the radar's frame."""
    out = np.full(spec.cells**2, -1.0, dtype=np.float32)
    bearing, distance = np.arctan2(lidar[:, 1], lidar[:, 0]), np.hypot(lidar[:, 0], lidar[:, 1])
    points, _ = along(np.zeros(2), bearing, distance - 0.3, 0.5, spec.cell / 2)
    for value, places in ((0.0, points), (1.0, lidar)):
        cells = spec.locate(base_from_sensor.apply(places))
        out[cells[cells >= 0]] = value
    return out.reshape(spec.cells, spec.cells)


def elfes(radar: Floats, base_from_sensor: SE2, spec: GridSpec) -> Image:
    """(H, W) log-odds by five rays to each of the points (N, 2) m in the radar's frame."""
    bearing = (np.arctan2(radar[:, 1], radar[:, 0])[:, None] + ELFES_RAYS).reshape(-1)
    distance = np.repeat(np.hypot(radar[:, 0], radar[:, 1]), len(ELFES_RAYS))
    points, ray = along(np.zeros(2), bearing, distance - 0.4, 0.3, spec.cell)
    passed = once(spec.locate(base_from_sensor.apply(points)), ray, spec.cells**2)
    out = ELFES_FREE * np.bincount(passed, minlength=spec.cells**2)
    for step, added in ((-spec.cell, ELFES_BESIDE), (0.0, ELFES_HIT), (spec.cell, ELFES_BESIDE)):
        ends = (distance + step)[:, None] * np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)
        cells = spec.locate(base_from_sensor.apply(ends))
        out += added * np.bincount(cells[cells >= 0], minlength=spec.cells**2)
    return out.astype(np.float32).reshape(spec.cells, spec.cells)


def score(name: str, frames: list[Frame], judge: Judge, track: Track = untracked) -> FrameScores:
    """Over the observed cells of all frames together."""
    labels, scores = [], dict[str, list[NDArray[np.floating]]]()
    for frame in track(frames, f"judging frames, {judge.place} patch"):
        one = judge(frame)
        observed = one.label >= 0
        labels.append(one.label[observed] > 0)
        for method, values in one.scores.items():
            scores.setdefault(method, []).append(values[observed])
    occupied = np.concatenate(labels)
    precision = {method: average_precision(np.concatenate(values), occupied) for method, values in scores.items()}
    return FrameScores(name, judge.place, len(frames), len(occupied), float(occupied.mean()), precision)
