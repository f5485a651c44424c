"""The maps of all methods over the same drive, by the service's own mapping, and what they say beside the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.inverse_sensor_model import AnalyticSensorModel
from echogrid.core.evidence.raster import Image, rasterize
from echogrid.core.map.look_map import LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.read_out import read_out
from echogrid.core.map.tile import Layers
from echogrid.core.mapper import Mapper
from echogrid.core.motion.se2 import SE2
from echogrid_training.evaluation.reading import Scores
from echogrid_training.evaluation.simulated.baselines import Elfes
from echogrid_training.evaluation.simulated.elfes_maps import BeamModels, SummedBeams
from echogrid_training.evaluation.simulated.learned import Key, Network
from echogrid_training.evaluation.simulated.tally import Place
from echogrid_training.evaluation.simulated.tape import Marks, Tape, outside, play
from echogrid_training.learning.dataset import SPEC
from echogrid_training.truth.local_map import EVERY, patch

Level = Literal["patch", "around", "finished", "revisited", "cold"]
ELFES, TUNED, GEOMETRY = "Elfes, sum", "Elfes, sum, tuned", "geometric layer of looks"


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One way to read one map; several rows may read the same one."""

    key: Key
    mapper: Mapper
    read: Callable[[Layers], Scores]  # log-odds or what rises with them; 0 where nothing is known

    @property
    def published(self) -> bool:
        """Whether this is what the service publishes of the map."""
        return self.read == self.mapper.map.read


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What all maps say of one place: `around` the car as it passes, or of the `finished` map."""

    level: Level
    place: Place
    scores: dict[Key, Scores]


class Geometry:
    """The service's analytic model of a drive's car; remembers its last answer, since all maps ask for the same at every update."""

    def __init__(self, tape: Tape) -> None:
        self._model = AnalyticSensorModel(SPEC, tuple(tape.mounts.values()), tape.config.sensor_model.beam())
        self._image: Image | None = None
        self._said: Image = np.empty(0, dtype=np.float32)

    def __call__(self, around: Surroundings) -> Image:
        """(H, W) log-odds, as pipeline.py has the model say them."""
        image = rasterize(around.now.points, SPEC)
        if self._image is None or not np.array_equal(image, self._image):
            self._image, self._said = image, self._model(image)
        return self._said


def rows(tape: Tape, geometry: Geometry, of: Mapping[Key, Network], tuned: Sequence[Elfes]) -> list[Row]:
    """Empty maps: the service's analytic model, `tuned` with other beams, and every network by the rules `looks` and `sum`, and by the
    paper's Eq. (1), which has no clamp."""
    bounds = tape.config.map.clamp, tape.config.map.max_tiles
    elfes = tape.mapper(geometry, OccupancyMap(SPEC, *bounds))
    out = [Row((ELFES, 0), elfes, elfes.map.read)]
    if tuned:
        others = tape.mapper(BeamModels(tape, tuned), SummedBeams(SPEC, tuned, tape.config.map.max_tiles))
        out += [Row((TUNED, index), others, partial(layer, index)) for index in range(len(tuned))]
    for place, ((name, number), network) in enumerate(of.items()):
        looks = tape.mapper(partial(averaged, network), LookMap(SPEC, network.model.contract.calibration, *bounds))
        total = tape.mapper(partial(summed, network), OccupancyMap(SPEC, *bounds))
        endless = tape.mapper(partial(summed, network), OccupancyMap(SPEC, math.inf, tape.config.map.max_tiles))
        out += [
            Row((f"{name}, looks", number), looks, looks.map.read),
            Row((f"{name}, sum", number), total, total.map.read),
            Row((f"{name}, sum without clamp", number), endless, partial(layer, 0)),
            Row((f"{name}, learned layer of looks", number), looks, learned_layer),
        ]
        if place == 0:  # the same whatever network it stands beside
            out.append(Row((GEOMETRY, 0), looks, geometric_layer))
    return out


def averaged(network: Network, around: Surroundings) -> Image:
    """What a LookMap takes, as sensor_model.py makes it."""
    log_odds, weight = network(around)
    return np.asarray((log_odds, weight))


def summed(network: Network, around: Surroundings) -> Image:
    """What an OccupancyMap takes, as pipeline.py makes it."""
    log_odds, weight = network(around)
    return np.asarray(log_odds * weight)


def layer(index: int, layers: Layers) -> Scores:
    """One of them, as it is."""
    return np.asarray(layers[index])


def learned_layer(layers: Layers) -> Scores:
    """The mean of the network's log-odds alone."""
    total, weight = layers[:2]
    return np.where(weight > 0, total / np.maximum(weight, np.float32(1e-6)), np.float32(0))


def geometric_layer(layers: Layers) -> Scores:
    """What was measured alone."""
    measured = layers.copy()
    measured[:2] = 0
    return read_out(measured)


def mappers(of: Iterable[Row]) -> list[Mapper]:
    """Each one once."""
    return list({id(row.mapper): row.mapper for row in of}.values())


@dataclass(frozen=True, slots=True)
class Stop:
    """Where the car was at a mark on its way: by dead reckoning, and truly."""

    odom_from_base: SE2
    truth_from_base: SE2


def drive_through(tape: Tape, of: Sequence[Row]) -> Iterator[View]:
    """Plays the drive into the rows' maps: a view around the car every EVERY m of way, and in the end the finished maps at the same places.

    Dead reckoning drifts against the truth, but hardly within a window: places are where it had the car at that moment.
    """
    marks = Marks(EVERY)
    stops: list[Stop] = []
    for ego in play(tape.events, mappers(of)):
        pose = tape.truth.pose(ego.stamp_ns)
        if pose is not None and marks.reached(pose):
            stop = Stop(ego.odom_from_base, pose)
            if stops:  # at the start there is no map yet
                yield view("around", tape, of, stop)
            stops.append(stop)
    for stop in stops:
        yield view("finished", tape, of, stop)


def view(level: Level, tape: Tape, of: Sequence[Row], stop: Stop) -> View:
    """Of all rows' maps at a place."""
    place = Place.plain(tape.truth.map.patch(stop.truth_from_base, SPEC), outside(tape.config, SPEC))
    layers = {id(mapper): patch(mapper.map, stop.odom_from_base, SPEC) for mapper in mappers(of)}
    return View(level, place, {row.key: row.read(layers[id(row.mapper)]) for row in of})


def replayed(tape: Tape, of: Sequence[Row]) -> list[Row]:
    """Rows over the same maps, with new mappers: the second time, dead reckoning says the same."""
    fresh = {id(mapper): tape.mapper(mapper.infer, mapper.map) for mapper in mappers(of)}
    return [Row(row.key, fresh[id(row.mapper)], row.read) for row in of]
