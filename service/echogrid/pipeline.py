"""The whole chain for one car, from CAN messages to map updates: what `run`, `replay` and `demo` have in common."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import FrameBatch
from echogrid.can.signals import SignalReader, buses_of
from echogrid.config.tables import Config
from echogrid.core.health import Health
from echogrid.core.mapper import Mapper, MapUpdate
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.core.motion.map_frame import MapFrame
from echogrid.core.trust.watch import State
from echogrid.model.sensor_model import sensor_model
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
            errors=ErrorFilter(tuple(mounts), config.motion.learns),
            frame=None if config.pose is None else MapFrame(config.pose.base_from_point(), self.health.pose),
        )

    def take(self, batch: FrameBatch, buses: NDArray[np.int64]) -> Iterator[tuple[int, MapUpdate | None]]:
        """Frames (N,) of buses (N,), by their number in the configuration or UNKNOWN_BUS; step by step how many of them were taken, and
        the map's next state where it has changed: behind the frame that ended a cycle, and at the end of each piece."""
        for end, found in self.signals.pieces(batch, buses, self.mapper.span):
            now_ns, last = self.signals.newest_ns, end - 1
            for place, item in found:
                for update in self.mapper.take(item, now_ns if place == last else None):
                    yield place + 1, update
            yield end, None if now_ns is None else self.mapper.update(now_ns)

    def updates(self, batches: Iterable[FrameBatch]) -> Iterator[MapUpdate]:
        """The map's states that a recording gives, which says itself of which buses its frames are."""
        for batch in batches:
            yield from (update for _, update in self.take(batch, buses_of(batch, self.config.bus)) if update is not None)

    def keep(self, path: Path, begun_ns: int, lock: threading.Lock) -> TileKeeper:
        """To be called before the first message: tiles are kept in a file, and epochs count on from those in it. Raises EchogridError."""
        radars = tuple(radar.name for radar in self.config.radar)
        description = describe(self.mapper.map, self.config.vehicle, radars, begun_ns)
        keeper = TileKeeper(path, self.config.store, self.mapper.map, description, lock)
        self.mapper.keep(keeper, keeper.epoch)
        return keeper

    def state(self, silence_ns: int) -> State:
        """State of the map, `silence_ns` after the newest frame was processed."""
        newest_ns = self.signals.newest_ns
        if newest_ns is None:
            return State("stale", ("no map yet: no frame so far",))
        return self.mapper.watch.state(newest_ns + silence_ns + self.signals.time.waiting_ns)

    def pose(self, silence_ns: int) -> dict[str, Any] | None:
        """Of the poses from outside, for a status: their state and why, where odom lies, and counters; None where there are none."""
        frame = self.mapper.frame
        if frame is None:
            return None
        state, reason = frame.state((self.signals.newest_ns or 0) + silence_ns + self.signals.time.waiting_ns)
        at = frame.map_from_odom
        placed = None if at is None else {"x": round(at.x, 3), "y": round(at.y, 3), "yaw_deg": round(math.degrees(at.yaw), 4)}
        return {"state": state, "reason": reason, "map_from_odom": placed, **asdict(frame.counts)}
