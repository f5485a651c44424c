"""A simulated drive decoded once, to be played into as many mappers as there are methods: the service's own, cycle by cycle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.can.signals import SignalReader
from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.health import Health, SensorHealth
from echogrid.core.map.tiled_map import TiledMap
from echogrid.core.mapper import Infer, Mapper
from echogrid.core.messages import EgoMotion, PoseFix, RadarScan
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid_training.evaluation.metrics import Mask
from echogrid_training.learning.dataset import SPEC
from echogrid_training.truth.simulated_truth import SimulatedTruth, load_simulated_truth


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """What one CAN message completed, and the newest receive time then."""

    items: Sequence[RadarScan | EgoMotion]
    now_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class Tape:
    """A drive's scans and ego motion in the order of its log, and its truth. `source`: the configuration's file."""

    config: Config
    source: Path
    truth: SimulatedTruth
    events: Sequence[Event]

    @property
    def mounts(self) -> dict[str, Mount]:
        """By radar."""
        return {radar.name: radar.mount() for radar in self.config.radar}

    def mapper(self, infer: Infer, occupancy: TiledMap) -> Mapper:
        """As pipeline.Pipeline makes it, with counters of its own."""
        health = Health()
        health.sensors.update({name: SensorHealth() for name in self.mounts})
        return Mapper(
            mounts=self.mounts,
            infer=infer,
            occupancy=occupancy,
            health=health,
            noise=self.config.gate.noise(),
            cycle_ns=round(self.config.map.cycle_ms * 1e6),
            max_age_ns=round(self.config.map.max_age_ms * 1e6),
        )


def load_tape(folder: Path) -> Tape:
    """Raises EchogridError."""
    drive = find_drive(folder, None)
    config = load_config(drive.config)
    if config.grid.spec() != SPEC:
        found = config.grid.spec()
        raise EchogridError(
            f"{drive.config}: grid of {found.cells} cells of {found.cell} m found, expected {SPEC.cells} of {SPEC.cell} m: "
            "the networks are made for that"
        )
    signals, events = SignalReader(config, drive.config, Health()), []
    cycle_ns = round(config.map.cycle_ms * 1e6)
    cycle = None
    for newest_ns, heard in signals.heard(Log(drive.log).batches(), config.bus):
        items = [item for item in heard if not isinstance(item, PoseFix)]
        if signals.newest_ns is not None and (items or newest_ns // cycle_ns != cycle):  # nothing else changes anything
            cycle = newest_ns // cycle_ns
            events.append(Event(items, newest_ns))
    return Tape(config, drive.config, load_simulated_truth(drive.truth), events)


def play(events: Iterable[Event], mappers: Sequence[Mapper]) -> Iterator[EgoState]:
    """All mappers, one event after the other; where the car is, whenever a cycle has ended. They share events, hence poses."""
    for event in events:
        updates = []
        for mapper in mappers:
            ended = [update for item in event.items for update in mapper.take(item, event.now_ns)]
            updates.append(mapper.update(event.now_ns) or (ended[-1] if ended else None))
        if updates[0] is not None:
            yield updates[0].ego


class Marks:
    """Remembers the last mark on the way; tells whether the next one is reached."""

    def __init__(self, spacing: float) -> None:
        self.spacing = spacing  # m
        self.last: SE2 | None = None

    def reached(self, pose: SE2) -> bool:
        """True at the first pose, and at every one that is `spacing` from the last mark or more, which is the mark then."""
        if self.last is not None and math.hypot(pose.x - self.last.x, pose.y - self.last.y) < self.spacing:
            return False
        self.last = pose
        return True


def outside(config: Config, spec: GridSpec) -> Mask:
    """(H, W): cells whose centre is not under the car."""
    x, y = np.moveaxis(spec.centres(), -1, 0)
    body = config.body
    under = (x >= -body.rear_overhang) & (x <= body.length - body.rear_overhang) & (np.abs(y) <= body.width / 2)
    mask: Mask = ~under
    return mask
