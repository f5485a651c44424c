"""A map of a recorded drive beside annotated truth: labelled standing objects, and the road in direct sight of them.

Scored is what is published: no threshold is chosen, nothing is fitted. Each cell of truth is looked up by its place relative to the car at
the pose nearest to it, so that drift of dead reckoning is not punished. Ground that the car drove over is left out, and so is what lies
outside the patch around every pose. Real returns lie inside the boxes and truth on their faces, hence an object is found within one cell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from echogrid.core.map.tiled_map import FREE, LogOdds, probability
from echogrid.core.messages import Floats
from echogrid.core.motion.odometry import EgoState
from echogrid_training.evaluation.metrics import average_precision, calibration_error, ratio, reliability, surprise
from echogrid_training.evaluation.recorded.scores import Rectangle
from echogrid_training.sources import load_npz

HALF = 15.0  # m, of the patch
DRIVEN = (-0.9, 3.7, 1.1)  # m in base: from, to, and to each side of what the car drives over
SILENT = -4.0  # log-odds where a map says nothing, for rank and NLL: about the share of occupied cells
FACE, LEAST_FACE = 0.25, 2  # m beside its box within which an occupied cell is an object's, cells of it that have to be seen
CONE = "trafficcone"  # in the kind of what a radar hardly sees
KEYS = ("truth", "origin", "cell", "pose_ns", "pose", "static_box_corners", "static_kind")
RESAMPLED, INTERVAL = 1000, (2.5, 97.5)


@dataclass(frozen=True, slots=True, eq=False)
class Annotated:
    """Truth of one scene, in the frame of its first pose."""

    truth: NDArray[np.int8]  # (H, W): 1 occupied, -1 free, 0 not judged; rows along y
    origin: Floats  # (2,) m, of the corner of cell [0, 0]
    cell: float  # m
    stamp_ns: NDArray[np.int64]  # (P,)
    poses: Floats  # (P, 3) x, y (m) and yaw (rad) of base
    boxes: Floats  # (B, 4, 2) m, corners of standing objects in turn
    kinds: tuple[str, ...]  # (B,)


def load_annotated(path: Path) -> Annotated:
    """Raises EchogridError."""
    arrays = load_npz(path, KEYS)
    return Annotated(
        arrays["truth"],
        arrays["origin"].astype(float),
        float(arrays["cell"]),
        arrays["pose_ns"],
        arrays["pose"].astype(float),
        arrays["static_box_corners"].astype(float),
        tuple(str(kind) for kind in arrays["static_kind"]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """The cells of truth that are judged, and where they lie in odom."""

    occupied: NDArray[np.bool_]  # (N,)
    places: Floats  # (N, 2) m in odom
    objects: tuple[tuple[str, NDArray[np.intp]], ...]  # kind, and which of the cells are its seen faces


def asked(truth: Annotated, driven: Sequence[EgoState]) -> Asked:
    """`driven`: where dead reckoning had the car. Only cells whose nearest pose lies within that time."""
    row, column = np.nonzero(truth.truth)
    centres = np.stack(((column + 0.5) * truth.cell + truth.origin[0], (row + 0.5) * truth.cell + truth.origin[1]), axis=-1)
    parts = np.array_split(centres, len(centres) // 2000 + 1)
    nearest = np.concatenate([((part[:, None] - truth.poses[None, :, :2]) ** 2).sum(axis=-1).argmin(axis=1) for part in parts])
    seen = _relative(centres, truth.poses[nearest])
    stamps = truth.stamp_ns[nearest]
    way = np.array([(ego.stamp_ns, ego.odom_from_base.x, ego.odom_from_base.y, ego.odom_from_base.yaw) for ego in driven], dtype=object)
    ours, place = way[:, 0].astype(np.int64), way[:, 1:].astype(float)
    kept = (np.abs(seen) <= HALF).all(axis=1) & (stamps >= ours[0]) & (stamps <= ours[-1])
    for pose in truth.poses[::5]:
        ahead, aside = _relative(centres, pose).T
        kept &= ~((ahead > DRIVEN[0]) & (ahead < DRIVEN[1]) & (np.abs(aside) < DRIVEN[2]))
    seconds = (stamps - ours[0]) * 1e-9
    x, y, yaw = (np.interp(seconds, (ours - ours[0]) * 1e-9, column) for column in (*place[:, :2].T, np.unwrap(place[:, 2])))
    cos, sin = np.cos(yaw), np.sin(yaw)
    places = np.stack((x + cos * seen[:, 0] - sin * seen[:, 1], y + sin * seen[:, 0] + cos * seen[:, 1]), axis=-1)
    occupied = truth.truth[row, column][kept] == 1
    return Asked(occupied, places[kept], tuple(_objects(truth, centres[kept], occupied)))


@dataclass(frozen=True, slots=True)
class Scene:
    """What one method's map says of one scene: counts and sums that add up, the average precision, and objects by kind."""

    ap: float
    occupied: int  # cells
    free: int
    known_free: int  # of the free ones, those about which the map says something
    occupied_called_free: int
    free_called_free: int
    free_called_occupied: int
    squared_free: float  # sum of (tanh(log-odds / 2) - label)^2, label -1
    squared_occupied: float  # label 1
    surprise: float  # sum over all cells, nats
    reliability: tuple[tuple[float, ...], ...]  # metrics.reliability of the known cells
    found: dict[str, int]  # objects by kind: p > 0.5 within one cell of a seen face
    lost: dict[str, int]  # every seen face cell called free
    objects: dict[str, int]


def score(log_odds: LogOdds, where: Rectangle, of: Asked) -> Scene:
    """`log_odds`: (H, W) of the rectangle, as published, 0 where nothing is known."""
    flat = where.flat(of.places)
    said = np.where(flat >= 0, log_odds.reshape(-1)[flat], 0.0).astype(float)
    near = np.where(flat >= 0, _widened(log_odds).reshape(-1)[flat], -np.inf)
    known, p = said != 0, probability(said.astype(np.float64))
    sure, ranked, occupied = known & (p < FREE), np.where(known, said, SILENT), of.occupied
    squared = (np.tanh(said / 2) - np.where(occupied, 1, -1)) ** 2
    found, lost, objects = dict[str, int](), dict[str, int](), dict[str, int]()
    for kind, cells in of.objects:
        for book, true in ((objects, True), (found, bool((near[cells] > 0).any())), (lost, bool(sure[cells].all()))):
            book[kind] = book.get(kind, 0) + true
    return Scene(
        ap=average_precision(ranked, occupied) if occupied.any() else float("nan"),
        occupied=int(occupied.sum()),
        free=int((~occupied).sum()),
        known_free=int((known & ~occupied).sum()),
        occupied_called_free=int((sure & occupied).sum()),
        free_called_free=int((sure & ~occupied).sum()),
        free_called_occupied=int((known & (p > 0.5) & ~occupied).sum()),
        squared_free=float(squared[~occupied].sum()),
        squared_occupied=float(squared[occupied].sum()),
        surprise=float(surprise(ranked, occupied).sum()),
        reliability=tuple(tuple(row) for row in reliability(p[known], occupied[known]).tolist()),
        found=found,
        lost=lost,
        objects=objects,
    )


@dataclass(frozen=True, slots=True)
class Figures:
    """Of all scenes together; `ap` is the mean over scenes. NaN of nothing."""

    found: float = field(metadata={"title": "objects found"})
    lost: float = field(metadata={"title": "objects called free"})
    lost_large: float = field(metadata={"title": "the same without cones"})
    occupied_called_free: float = field(metadata={"title": "occupied cells with p < 0.1"})
    free_called_free: float = field(metadata={"title": "free road with p < 0.1"})
    free_called_occupied: float = field(metadata={"title": "free road with p > 0.5"})
    mse_free: float = field(metadata={"title": "class MSE, free"})
    mse_occupied: float = field(metadata={"title": "class MSE, occupied"})
    nll: float = field(metadata={"title": "NLL"})
    ece: float = field(metadata={"title": "ECE"})
    ap: float = field(metadata={"title": "average precision, mean of scenes"})


TITLES = {one.name: one.metadata["title"] for one in fields(Figures)}
# A map that holds on roads keeps within these. `found` is a share of what the analytic model finds, `ap` a multiple of its.
LEAST = {"found": 0.95, "free_called_free": 0.75, "ap": 1.9}
MOST = {
    "lost": 0.09,
    "lost_large": 0.01,
    "occupied_called_free": 0.15,
    "free_called_occupied": 0.01,
    "mse_free": 0.35,
    "mse_occupied": 1.0,
    "nll": 0.065,
    "ece": 0.03,
}


def figures(scenes: Sequence[Scene]) -> Figures:
    """Of at least one."""

    def total(name: str) -> float:
        return float(sum(getattr(one, name) for one in scenes))

    def counted(name: str, *, cones: bool = True) -> float:
        books: list[dict[str, int]] = [getattr(one, name) for one in scenes]
        return float(sum(count for book in books for kind, count in book.items() if cones or CONE not in kind))

    occupied, free = total("occupied"), total("free")
    return Figures(
        found=ratio(counted("found"), counted("objects")),
        lost=ratio(counted("lost"), counted("objects")),
        lost_large=ratio(counted("lost", cones=False), counted("objects", cones=False)),
        occupied_called_free=ratio(total("occupied_called_free"), occupied),
        free_called_free=ratio(total("free_called_free"), free),
        free_called_occupied=ratio(total("free_called_occupied"), total("known_free")),
        mse_free=ratio(total("squared_free"), free),
        mse_occupied=ratio(total("squared_occupied"), occupied),
        nll=ratio(total("surprise"), occupied + free),
        ece=calibration_error(np.sum([one.reliability for one in scenes], axis=0)),
        ap=float(np.mean([one.ap for one in scenes])),
    )


def intervals(scenes: Sequence[Scene], seed: int = 0) -> dict[str, tuple[float, float]]:
    """By figure, the middle 95 in 100 of RESAMPLED draws of scenes with replacement."""
    draws = np.random.default_rng(seed).integers(0, len(scenes), size=(RESAMPLED, len(scenes)))
    drawn = [figures([scenes[index] for index in draw]) for draw in draws]
    out = {}
    for name in TITLES:
        low, high = np.nanpercentile([getattr(one, name) for one in drawn], INTERVAL)
        out[name] = (float(low), float(high))
    return out


def missed(of: Figures, yardstick: Figures) -> list[str]:
    """The figures that do not keep within LEAST and MOST; those that are not a number do not."""
    relative = {"found": ratio(of.found, yardstick.found), "ap": ratio(of.ap, yardstick.ap)}
    low = [name for name, least in LEAST.items() if not relative.get(name, getattr(of, name)) >= least]
    return low + [name for name, most in MOST.items() if not getattr(of, name) <= most]


def by_kind(scenes: Sequence[Scene]) -> Mapping[str, tuple[int, int, int]]:
    """Objects, found, called free, by kind."""
    kinds = sorted({kind for one in scenes for kind in one.objects})

    def total(book: str, kind: str) -> int:
        return sum(getattr(one, book).get(kind, 0) for one in scenes)

    return {kind: (total("objects", kind), total("found", kind), total("lost", kind)) for kind in kinds}


def _objects(truth: Annotated, centres: Floats, occupied: NDArray[np.bool_]) -> list[tuple[str, NDArray[np.intp]]]:
    out = []
    for kind, box in zip(truth.kinds, truth.boxes, strict=True):
        inside = occupied.copy()
        for side in (box[0] - box[1], box[0] - box[3]):
            length = float(np.hypot(*side))
            inside &= np.abs((centres - box.mean(axis=0)) @ (side / length)) <= length / 2 + FACE
        if inside.sum() >= LEAST_FACE:
            out.append((kind, np.flatnonzero(inside)))
    return out


def _relative(points: Floats, pose: Floats) -> Floats:
    """Points (N, 2) as seen from one pose (3,) or from a pose for each (N, 3)."""
    away = points - pose[..., :2]
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    return np.stack((away[..., 0] * cos + away[..., 1] * sin, away[..., 1] * cos - away[..., 0] * sin), axis=-1)


def _widened(log_odds: LogOdds) -> LogOdds:
    """(H, W): the largest of each cell and its eight neighbours, -inf where none is known."""
    padded = np.pad(np.where(log_odds == 0, np.float32(-np.inf), log_odds), 1, constant_values=-np.inf)
    height, width = log_odds.shape
    out: LogOdds = np.max([padded[i : i + height, j : j + width] for i in range(3) for j in range(3)], axis=0)
    return out
