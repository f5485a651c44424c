"""The service: receiving, mapping and publishing introduced to each other, each with a thread that owns its state."""

from __future__ import annotations

import logging
import os
import threading
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from msgspec import to_builtins

from echogrid.config.loading import remarks
from echogrid.config.tables import Config
from echogrid.core.kernels import dispatch as kernels
from echogrid.errors import EchogridError
from echogrid.live.learned_keeper import LearnedKeeper
from echogrid.live.manager import Manager
from echogrid.live.mapping import Mapping, Take
from echogrid.live.publishing import Publishing
from echogrid.live.receiving import Receiving
from echogrid.pipeline import Pipeline
from echogrid.recording.foxglove import Foxglove
from echogrid.recording.mcap_recorder import McapRecorder
from echogrid.store.claim import check_free
from echogrid.store.learned_file import LEARNED
from echogrid.store.store_file import SUFFIX
from echogrid.store.tile_keeper import TileKeeper, check_ours
from echogrid.threads import Workers
from echogrid.topics.announcer import Announcer
from echogrid.watching.metrics import Metrics
from echogrid.zenoh.map_reader import MapReader
from echogrid.zenoh.pose_feed import PoseFeed
from echogrid.zenoh.publisher import Publisher
from echogrid.zenoh.region import Regions

log = logging.getLogger("echogrid")
STATM, PAGE = Path("/proc/self/statm"), os.sysconf("SC_PAGE_SIZE")  # of Linux: pages of this process, and bytes of one
RELOADABLE = ("rate_hz", "window_cells")  # keys of [publish] that a running service takes over


class Service:
    """The caller's thread reads the buses and maps, one thread publishes, others guard, keep, record and answer; none waits for another.

    `take` takes frames to the pipeline; a recorder may replace it. `record`: an MCAP file of the frames and of what is published.
    `foxglove`: host and port of a live view. `begun_ns`: when the map in the store begins, if not now.
    `workers.stop` ends the service at its next look; `reload` is called from a signal's handler.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        take: Take | None = None,
        *,
        record: Path | None = None,
        foxglove: tuple[str, int] | None = None,
        begun_ns: int | None = None,
    ) -> None:
        self.pipeline = pipeline
        self.config = pipeline.config
        self.workers = Workers()
        self.live = threading.Event()  # all buses are open and the publisher is up
        self.receiving = Receiving(pipeline.signals)
        self.mapping = Mapping(pipeline, take or pipeline.take, self.receiving)
        self.publishing = Publishing(Announcer(self.config, pipeline.model.why), self.mapping.outbox, self.status)
        self.mapping.listened = self.publishing.listened
        self.manager = Manager(self.mapping.loop_age)
        self.publisher: Publisher | None = None
        self.keeper: TileKeeper | None = None
        self.learned: LearnedKeeper | None = None
        self.recorder: McapRecorder | None = None
        self._record, self._foxglove, self._begun_ns = record, foxglove, begun_ns
        self._rates = Rates()

    def run(self) -> None:
        """Until `workers.stop` is set. Raises EchogridError where a bus or the publisher cannot be opened."""
        with ExitStack() as opened:
            self._open(opened)
            if self.learned is not None:
                opened.callback(self.learned.write)
            self.workers.add("guard", self.receiving.guard)
            self._report_live()  # before anything else is told of its state
            with self.workers:
                try:
                    self.mapping.run(self.workers.stop, None if self.recorder is None else self.recorder.frame)
                    with self.mapping.lock:
                        self.pipeline.mapper.learn()  # the end of the drive: nothing is heard behind its last cycle
                finally:
                    self.manager.notifier.stopping()
        if self.workers.failure is not None:
            raise self.workers.failure

    def status(self) -> dict[str, Any]:
        """What is published as status: the state of the map, how the service keeps up, and all counters."""
        state, health = self.mapping.state(), self.pipeline.health
        return {
            "state": state.name,
            "reasons": state.reasons + (() if self.publisher is None else self.publisher.reasons()),
            "epoch": self.pipeline.mapper.epoch,
            "model": self.pipeline.model.why,
            "kernels": kernels.WHY,
            "buses": {bus.bus.name: to_builtins(bus.refresh()) for bus in self.receiving.buses},
            "rates": self._rates.per_second(maps=health.cycles, frames=health.frames),
            "latency_ms": self.mapping.latency_ms(),
            "dropped_frames": self.receiving.queue.dropped,
            "dropped_motion": self.receiving.queue.dropped_motion,
            "store": None if self.keeper is None else to_builtins(self.keeper.status),
            "learned": self.pipeline.mapper.odometry.errors.learned(),
            "recording": None if self.recorder is None else to_builtins(self.recorder.recording),
            "rss_mib": resident_mib(),
            **to_builtins(health),
            "pose": self.mapping.pose(),
        }

    def reload(self, config: Config) -> None:
        """Takes over what of another configuration needs no restart. Raises EchogridError naming what does."""
        kept = {key: getattr(config.publish, key) for key in RELOADABLE}
        asked = msgspec.structs.replace(self.config, publish=msgspec.structs.replace(self.config.publish, **kept))
        if asked != config:
            keys = ", ".join(key for key in config.__struct_fields__ if getattr(config, key) != getattr(asked, key))
            raise EchogridError(f"{keys}: only {' and '.join(RELOADABLE)} of [publish] can change without a restart")
        self.config, self.mapping.settings = config, config.publish

    def _open(self, opened: ExitStack) -> None:
        """Everything that leads outside, and a worker for each that has work of its own; what is wrong names the configuration's file."""
        try:
            path = store_path(self.config)
            if path is not None:
                check_ours(path)  # before a bus or a port is opened
                check_free(path)
            publisher = opened.enter_context(Publisher(self.config.publish, self.config.vehicle, self.config.ros, self.config.pose))
            self.publisher = publisher
            self.publishing.sinks.append(publisher)
            if self.config.pose is not None and self.config.pose.key is not None:
                self.mapping.poses = PoseFeed(publisher.session, self.config.pose, self.pipeline.health.pose).take
            metrics = opened.enter_context(Metrics(self.config.metrics, self.config.vehicle))
            publish = partial(self.publishing.run, manager=self.manager, measure=metrics.update)
            self.workers.add("publisher", publish, self.mapping.outbox.wake)
            for remark in remarks(self.config):
                log.warning("%s", remark)
            self.receiving.open(self.config.read_buses, opened)
        except EchogridError as error:
            raise EchogridError(f"{self.pipeline.signals.source}: {error}") from error
        if self._foxglove is not None:
            view = opened.enter_context(Foxglove(*self._foxglove, self.config.vehicle))
            self.publishing.sinks.append(view)
            log.info("live for Foxglove on ws://%s:%d", self._foxglove[0], view.port)
        if self._record is not None:
            self.recorder = McapRecorder(self._record)
            opened.callback(self.recorder.close)
            self.publishing.sinks.append(self.recorder)
            self.workers.add("recorder", self.recorder.run)
        self._keep(path, opened)
        reader = MapReader(self.pipeline.mapper, self.mapping.lock, self.keeper)
        regions = Regions(publisher, self.config.grid.cell, reader)
        self.workers.add("regions", regions.run, regions.wake)

    def _keep(self, path: Path | None, opened: ExitStack) -> None:
        """Last of all, when nothing can be refused any more: who begins an epoch ends that of a service that writes the same file."""
        if path is None:
            return
        begun_ns = time.time_ns() if self._begun_ns is None else self._begun_ns
        self.keeper = opened.enter_context(self.pipeline.keep(path, begun_ns, self.mapping.lock))
        self.workers.add("keeper", self.keeper.run)
        self.learned = LearnedKeeper(path.with_suffix(LEARNED), self.config, self.pipeline.mapper.odometry.errors, self.mapping.lock)
        self.workers.add("learned", self.learned.run)

    def _report_live(self) -> None:
        self.live.set()
        log.info("inverse sensor model: %s", self.pipeline.model.why)
        (log.info if kernels.COMPILED else log.warning)("kernels: %s", kernels.WHY)
        buses = ", ".join(f"{bus.name} ({bus.interface} {bus.channel})" for bus in self.config.read_buses)
        log.info("live on %s", buses)
        self.manager.notifier.ready(f"live on {buses}; no map yet")


class Rates:
    """Remembers the last counts and when they were taken."""

    def __init__(self) -> None:
        self._at = time.monotonic()
        self._maps = self._frames = 0

    def per_second(self, maps: int, frames: int) -> dict[str, float]:
        """Since the last call."""
        now = time.monotonic()
        span = max(now - self._at, 1e-3)
        rates = {"map_hz": (maps - self._maps) / span, "frames_hz": (frames - self._frames) / span}
        self._at, self._maps, self._frames = now, maps, frames
        return rates


def store_path(config: Config) -> Path | None:
    """Where the map is kept; None where it is not."""
    if config.store.path is not None:
        return Path(config.store.path)
    folder = os.environ.get("STATE_DIRECTORY")
    return None if folder is None else Path(folder) / f"map{SUFFIX}"


def resident_mib() -> float:
    """Memory of this process that is in RAM."""
    return int(STATM.read_bytes().split()[1]) * PAGE / (1 << 20)
