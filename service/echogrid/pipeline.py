"""The whole chain for one car, from CAN messages to map updates: what `run`, `replay` and `demo` have in common."""

from __future__ import annotations

from pathlib import Path

import can

from echogrid.config import Config
from echogrid.core.health import Health
from echogrid.core.inverse_sensor_model import AnalyticSensorModel
from echogrid.core.mapper import InverseSensorModel, Mapper, MapUpdate
from echogrid.core.messages import RadarScan
from echogrid.core.occupancy import OccupancyMap
from echogrid.errors import EchogridError
from echogrid.io.signals import SignalReader


class Pipeline:
    """Remembers the signals' and the mapper's state. Time is that of the messages: the same log gives the same map, bit for bit."""

    def __init__(self, config: Config, source: Path) -> None:
        """`source`: the configuration's file. Raises EchogridError before anything is opened."""
        self.config = config
        self.health = Health()
        self.signals = SignalReader(config, source, self.health)
        mounts = {radar.name: radar.mount() for radar in config.radar}
        spec = config.grid.spec()
        self.mapper = Mapper(
            mounts=mounts,
            infer=sensor_model(config, source),
            occupancy=OccupancyMap(spec, config.map.clamp, config.map.max_tiles),
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


def sensor_model(config: Config, source: Path) -> InverseSensorModel:
    """The inverse sensor model that the configuration names. Raises EchogridError where a model file is not sound."""
    spec = config.grid.spec()
    if config.model == "analytic":
        return AnalyticSensorModel(spec, tuple(radar.mount() for radar in config.radar), config.sensor_model.beam())
    from echogrid.io.model import OnnxSensorModel  # onnxruntime is loaded only where a network runs

    try:
        return OnnxSensorModel(source.parent / config.model, spec)
    except EchogridError as error:
        raise EchogridError(f"{source}: model: {error}") from error
