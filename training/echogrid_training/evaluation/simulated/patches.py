"""Single map updates of a simulated drive: all that a sensor model may know there, the truth, and which cells are judged apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.history_raster import CHANNELS, Bytes, HistoryRaster
from echogrid.core.evidence.raster import GridSpec, Image, rasterize
from echogrid.core.map.look_map import Calibration
from echogrid.core.radar.mount import Mount
from echogrid_training.drives.samples import SPACING, Unwritten
from echogrid_training.evaluation.metrics import Mask
from echogrid_training.evaluation.simulated.tally import Place
from echogrid_training.evaluation.simulated.tape import Marks, Tape, outside, play
from echogrid_training.learning.dataset import SPEC

RINGS = ((0.0, 5.0), (5.0, 10.0), (10.0, 15.0))  # m from base
STRATA = (
    *(f"{near:g} to {far:g} m" for near, far in RINGS),
    "in view, first surface",  # of the truth, along the ray from any radar that is heard
    "in view, behind a surface",
    "out of view, looked at",  # within the last 15 m of way
    "never looked at",
)
BEARINGS = 1440  # of the rays that find first surfaces: 0.25°, less than a cell at the patch's corner
BEHIND = 1.0  # cells behind the first surface's first point that still count as that surface


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """One map update of a drive: `around` in base as the service's sensor model gets it, and `image` as it is drawn for the network."""

    around: Surroundings
    image: Bytes  # (12, H, W)
    lidar: Bytes  # (H, W): 1 where the lidar has a return in its newest turn, else 0
    mounts: dict[str, Mount]
    place: Place

    def plane(self, channel: str) -> Bytes:
        """(H, W), by its name in history_raster.CHANNELS."""
        return np.asarray(self.image[CHANNELS.index(channel)])


def patches(tape: Tape, count: int) -> Iterator[Patch]:
    """At most `count` of the drive's map updates, evenly spread over those SPACING m of way apart."""
    seen: list[Surroundings] = []

    def infer(around: Surroundings) -> Image:
        seen[:] = [around]
        return np.empty(0, dtype=np.float32)  # no map is made

    mapper = tape.mapper(infer, Unwritten(SPEC, Calibration()))
    marks, found = Marks(SPACING), []
    for ego in play(tape.events, [mapper]):
        pose = tape.truth.pose(ego.stamp_ns)
        if seen and pose is not None and marks.reached(pose):
            found.append((seen[0], pose, ego.stamp_ns))
        seen.clear()
    raster, outer = HistoryRaster(SPEC, tape.mounts), outside(tape.config, SPEC)
    for index in spread(len(found), count):
        around, pose, stamp_ns = found[index]
        lidar = (rasterize(tape.truth.lidar_points(stamp_ns, pose), SPEC)[0] > 0).astype(np.uint8)
        truth, image = tape.truth.map.patch(pose, SPEC), raster(around)
        mounts = [tape.mounts[name] for name in around.live]
        yield Patch(around, image, lidar, tape.mounts, Place(truth, outer, strata(truth > 0, image, mounts, SPEC)))


def spread(length: int, count: int) -> Sequence[int]:
    """At most `count` indices into so many things, evenly spread."""
    return sorted({int(index) for index in np.linspace(0, length - 1, min(length, count))})


def strata(occupied: Mask, image: Bytes, mounts: Sequence[Mount], spec: GridSpec) -> NDArray[np.bool_]:
    """(len(STRATA), H, W). occupied (H, W): of the truth; image: history_raster's planes; mounts: of the radars that are heard."""
    x, y = np.moveaxis(spec.centres(), -1, 0)
    distance = np.hypot(x, y)
    view = image[CHANNELS.index("view")] > 0
    looked = image[CHANNELS.index("looks_15m")] > 0
    first = np.zeros_like(view)
    for mount in mounts:
        first |= in_sight(occupied, mount, spec)
    rings = [(distance >= near) & (distance < far) for near, far in RINGS]
    return np.stack((*rings, view & first, view & ~first, ~view & looked, ~view & ~looked))


def in_sight(occupied: Mask, mount: Mount, spec: GridSpec) -> Mask:
    """(H, W): cells in a radar's field of view with nothing occupied before them on the ray from the radar, they themselves may be."""
    origin = np.array((mount.base_from_sensor.x, mount.base_from_sensor.y))
    bearing = (np.arange(BEARINGS) + 0.5) * (2 * np.pi / BEARINGS)
    step = spec.cell / 2
    along = np.arange(1, int(2 * np.sqrt(2) * spec.half / step)) * step  # (K,) m
    rays = np.stack((np.cos(bearing), np.sin(bearing)), axis=-1)
    cells = spec.locate(origin + along[None, :, None] * rays[:, None, :])  # (BEARINGS, K)
    met = (cells >= 0) & occupied.reshape(-1)[cells]
    first = np.where(met.any(axis=1), along[met.argmax(axis=1)], np.inf)  # (BEARINGS,) m
    away = spec.centres() - origin
    which = (np.arctan2(away[..., 1], away[..., 0]) % (2 * np.pi) * (BEARINGS / (2 * np.pi))).astype(np.intp) % BEARINGS
    sight: Mask = mount.sees(spec.centres()) & (np.hypot(away[..., 0], away[..., 1]) <= first[which] + BEHIND * spec.cell)
    return sight
