"""Which inverse sensor model answers, and which map takes its answers, as the configuration says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.config.tables import Config
from echogrid.core.evidence.history import Surroundings
from echogrid.core.evidence.inverse_sensor_model import AnalyticSensorModel
from echogrid.core.evidence.raster import Image, rasterize
from echogrid.core.map.look_map import Calibration, LookMap
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.map.tiled_map import TiledMap
from echogrid.core.mapper import Infer
from echogrid.errors import EchogridError

UNCALIBRATED = "summed as it answers: its calibration is for the rule 'looks'"


@dataclass(frozen=True, slots=True, eq=False)
class SensorModel:
    """What turns surroundings into what the map takes, and the empty map that takes it."""

    infer: Infer
    map: TiledMap
    why: str  # which model this is and why, for log and status


def sensor_model(config: Config, source: Path) -> SensorModel:
    """As the configuration says. Raises EchogridError if a model file fails its checks and the configuration allows no other."""
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
    network = choice.model
    if (config.map.fusion or network.contract.fusion) == "sum":

        def summed(around: Surroundings) -> Image:
            log_odds, weight = network(around)
            return np.asarray(log_odds * weight)

        said = choice.why if network.contract.calibration == Calibration() else f"{choice.why}; {UNCALIBRATED}"
        return SensorModel(summed, _sum(config), said)

    tiles = config.map.tiles(LookMap.layers)
    looks = LookMap(spec, network.contract.calibration, config.map.clamp, tiles, config.sensor_model.beam())
    return SensorModel(network, looks, choice.why)


def _sum(config: Config) -> OccupancyMap:
    return OccupancyMap(config.grid.spec(), config.map.clamp, config.map.tiles(OccupancyMap.layers))


def _geometry(config: Config) -> AnalyticSensorModel:
    return AnalyticSensorModel(config.grid.spec(), tuple(radar.mount() for radar in config.radar), config.sensor_model.beam())
