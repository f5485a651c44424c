"""A replay as an MCAP file: the log's frames, and what the service would have published of them."""

from __future__ import annotations

import logging
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Self

import can
import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import FrameBatch
from echogrid.can.intake.table import UNKNOWN_BUS
from echogrid.core.mapper import MapUpdate
from echogrid.pipeline import Pipeline
from echogrid.recording.mcap_writer import McapWriter
from echogrid.topics.announcer import Announcer, Snapshots

log = logging.getLogger(__name__)
STATUS_PERIOD_NS = 1_000_000_000


class ReplayRecording:
    """Remembers what was published. All times are the traffic's own, so the same log gives the same file."""

    def __init__(self, path: Path, pipeline: Pipeline) -> None:
        """Raises EchogridError where the file cannot be made."""
        self.path = path
        self.pipeline = pipeline
        self.left_out = 0  # messages of the log that are not frames
        self._writer = McapWriter(path)
        self._announcer = Announcer(pipeline.config, pipeline.model.why)
        self._snapshots = Snapshots()
        self._told_ns: int | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._writer.close()
        if self.left_out:
            log.warning("%s: %d messages of the log are not CAN frames and were left out", self.path, self.left_out)

    def add(self, bus: str, message: can.Message, update: MapUpdate | None) -> None:
        """A frame that was mapped, and what came of it."""
        try:
            self._writer.frame(bus, message)
        except ValueError:
            self.left_out += 1
        if update is None:
            return
        snapshot = self._snapshots.take(self.pipeline.mapper, update, self.pipeline.config.publish)
        if snapshot is not None:
            for published in self._announcer.map(snapshot):
                self._writer.put(published)
        self._tell(update.ego.stamp_ns)

    def take(self, batch: FrameBatch, buses: NDArray[np.int64], update: MapUpdate | None) -> None:
        """Frames (N,) that were mapped, their buses as of `buses_of`, and what came of the last one."""
        names, last = [bus.name for bus in self.pipeline.config.bus], len(batch) - 1
        for place, (number, message) in enumerate(zip(buses.tolist(), batch, strict=True)):
            bus = str(message.channel) if number == UNKNOWN_BUS else names[number]
            self.add(bus, message, update if place == last else None)

    def discard(self) -> None:
        """Takes the file away again, where there was nothing to record."""
        self._writer.discard()

    def _tell(self, stamp_ns: int) -> None:
        """Status and diagnostics, once a second; what does not change before the first."""
        if self._told_ns is None:
            self._writer.put(self._announcer.meta(stamp_ns))
        elif 0 <= stamp_ns - self._told_ns < STATUS_PERIOD_NS:
            return
        self._told_ns = stamp_ns
        state = self.pipeline.state(0)
        status = {
            "state": state.name,
            "reasons": state.reasons,
            "epoch": self.pipeline.mapper.epoch,
            "model": self.pipeline.model.why,
            "buses": {},
            **asdict(self.pipeline.health),
            "pose": self.pipeline.pose(0),
        }
        for published in self._announcer.status(status, stamp_ns):
            self._writer.put(published)
