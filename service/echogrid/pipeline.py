"""The whole chain for one car, from CAN messages to map updates: what `run`, `replay` and `demo` have in common."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path

import can
import numpy as np

from echogrid.can.signals import SignalReader
from echogrid.config.tables import Config
from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.inverse_sensor_model import AnalyticSensorModel
from echogrid.core.evidence.raster import Image, rasterize
from echogrid.core.health import Health
from echogrid.core.map.look_map import LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tiled_map import TiledMap
from echogrid.core.mapper import Infer, Mapper, MapUpdate
from echogrid.core.messages import RadarScan
from echogrid.core.trust.watch import State
from echogrid.errors import EchogridError
from echogrid.store.stored_map import describe
from echogrid.store.tile_keeper import TileKeeper


class Pipeline:
    """Remembers the signals' and the mapper's state. Time is that of the messages: the same log gives the same map, bit for bit."""

    def __init__(self, config: Config, source: Path) -> None:
        """`source`: the configuration's file. Raises EchogridError before anything is opened."""
        self.config = config
        self.health = Health()
        self.signals = SignalReader(config, source, self.health)
        mounts = {radar.name: radar.mount() for radar in config.radar}
        self.model = sensor_model(config, source)
        self.mapper = Mapper(
            mounts=mounts,
            infer=self.model.infer,
            occupancy=self.model.map,
            health=self.health,
            noise=config.gate.noise(),
            cycle_ns=round(config.map.cycle_ms * 1e6),
            max_age_ns=round(config.map.max_age_ms * 1e6),
        )

    def add(self, bus: str, message: can.Message) -> MapUpdate | None:
        """One CAN message of a bus; the map's next state where it ends a cycle."""
        for item in self.signals.add(bus, message):
            if isinstance(item, RadarScan):
                self.mapper.on_scan(item)
            else:
                self.mapper.on_motion(item)
        if self.signals.newest_ns is None:
            return None
        return self.mapper.update(self.signals.newest_ns)

    def keep(self, path: Path, begun_ns: int, lock: threading.Lock) -> TileKeeper:
        """To be called before the first message: tiles are kept in a file, and epochs count on from those in it. Raises EchogridError."""
        radars = tuple(radar.name for radar in self.config.radar)
        description = describe(self.mapper.map, self.config.vehicle, radars, begun_ns)
        keeper = TileKeeper(path, self.config.store, self.mapper.map, description, lock)
        self.mapper.keep(keeper, keeper.epoch)
        return keeper

    def state(self, silence_ns: int) -> State:
        """Of the map, `silence_ns` after the newest frame was taken in."""
        newest_ns = self.signals.newest_ns
        if newest_ns is None:
            return State("stale", ("no map yet: no frame so far",))
        return self.mapper.watch.state(newest_ns + silence_ns + self.signals.time.waiting_ns)


@dataclass(frozen=True, slots=True, eq=False)
class SensorModel:
    """What turns surroundings into what the map takes, and the empty map that takes it."""

    infer: Infer
    map: TiledMap
    why: str  # which model this is and why, for log and status


def sensor_model(config: Config, source: Path) -> SensorModel:
    """As the configuration says. Raises EchogridError where a model file is not sound and it allows no other."""
    if config.model == "analytic":
        return _analytic(config, "the analytic model, as configured")
    try:
        return _network(config, source)
    except EchogridError as error:
        if not config.model_fallback:
            raise EchogridError(f"{source}: model: {error}") from error
        return _analytic(config, f"the analytic model, in place of '{config.model}': {error}")


def _analytic(config: Config, why: str) -> SensorModel:
    spec = config.grid.spec()
    model = _geometry(config)
    return SensorModel(lambda around: model(rasterize(around.now.points, spec)), _sum(config), why)


def _network(config: Config, source: Path) -> SensorModel:
    from echogrid.model.choice import SHIPPED, choose  # onnxruntime is loaded only where a network runs

    spec = config.grid.spec()
    mounts = {radar.name: radar.mount() for radar in config.radar}
    name = config.model if config.model in SHIPPED else str(source.parent / config.model)
    choice = choose(name, spec, mounts, config.model_sha256)
    network, geometry = choice.model, _geometry(config)
    if (config.map.fusion or network.contract.fusion) == "sum":

        def summed(around: Surroundings) -> Image:
            log_odds, weight = network(around)
            return np.asarray(log_odds * weight)

        return SensorModel(summed, _sum(config), choice.why)

    def averaged(around: Surroundings) -> Image:
        return np.stack((*network(around), geometry(rasterize(around.now.points, spec))))

    looks = LookMap(spec, network.contract.calibration, config.map.clamp, config.map.tiles(LookMap.layers))
    return SensorModel(averaged, looks, choice.why)


def _sum(config: Config) -> OccupancyMap:
    return OccupancyMap(config.grid.spec(), config.map.clamp, config.map.tiles(OccupancyMap.layers))


def _geometry(config: Config) -> AnalyticSensorModel:
    return AnalyticSensorModel(config.grid.spec(), tuple(radar.mount() for radar in config.radar), config.sensor_model.beam())
