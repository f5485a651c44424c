"""The service: buses, mapping and publishing introduced to each other. The only place with threads and signals."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import can
import msgspec
import numpy as np

from echogrid.can.bus import LiveBus
from echogrid.can.frame_queue import FrameQueue
from echogrid.can.motion import MotionReader
from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.mapper import MapUpdate
from echogrid.core.trust.watch import State
from echogrid.errors import EchogridError
from echogrid.pipeline import Pipeline
from echogrid.recording.foxglove import Foxglove
from echogrid.recording.mcap_recorder import McapRecorder
from echogrid.store.store_file import SUFFIX
from echogrid.store.tile_keeper import TileKeeper
from echogrid.topics.announcer import Announcer, Snapshot, Snapshots
from echogrid.topics.topic import Message, Sink
from echogrid.watching.metrics import Metrics
from echogrid.watching.systemd import Notifier
from echogrid.zenoh.map_reader import MapReader
from echogrid.zenoh.publisher import Publisher
from echogrid.zenoh.region import Regions

log = logging.getLogger("echogrid")
QUEUE_FRAMES = 4096  # one to two seconds of four radars
STATUS_PERIOD = 1.0  # s
META_PERIOD = 10.0  # s: whoever comes later is given the last one, but for who reaches a router at the same moment as the service
WAIT = 0.1  # s: a thread looks this often whether it is to end
MOST_LAG = 1.0  # s behind the buses, beyond which the newest map is old
TURNING = 1.0  # s within which the mapping has to come round for the watchdog
LATENCIES = 512  # of the newest map updates
RELOADABLE = ("rate_hz", "window_cells")  # keys of [publish] that a running service takes over


class Service:
    """One thread per bus receives, the caller's thread maps, one thread publishes; none waits for another.

    `add` takes each message to the pipeline; a recorder may stand in for it. `record`: an MCAP file of the frames and of what is published.
    `foxglove`: host and port of a live view. `stop` ends the service at its next look; `reload` is called from a signal's handler.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        add: Callable[[str, can.Message], MapUpdate | None] | None = None,
        *,
        record: Path | None = None,
        foxglove: tuple[str, int] | None = None,
    ) -> None:
        self.pipeline = pipeline
        self.config = pipeline.config
        self.add = add or pipeline.add
        self.stop = threading.Event()
        self.live = threading.Event()  # all buses are open and the publisher is up
        self.queue = FrameQueue(QUEUE_FRAMES, self._is_motion)
        self.snapshots = Snapshots()
        self.outbox = _Outbox()
        self.sinks: list[Sink] = []  # of what is published
        self.notifier = Notifier()
        self.buses: list[LiveBus] = []
        self.failure: Exception | None = None
        self.mapped_at = time.monotonic()  # when the newest frame was taken in: a lag is latency, not silence
        self.lag = 0.0  # s, from that frame's receipt to then
        self.turned_at = time.monotonic()  # when the mapping last came round
        self.latencies: deque[float] = deque(maxlen=LATENCIES)  # s, from a frame's receipt to the map update that it ended
        self.rates = _Rates()
        self.told: State | None = None  # the state that the journal knows, and since when
        self.told_at = time.monotonic()
        self.map_lock = threading.Lock()  # held by the mapping while it changes the map, by others for one tile's copy at a time
        self.keeper: TileKeeper | None = None
        self.record = record
        self.recorder: McapRecorder | None = None
        self.foxglove = foxglove

    def run(self) -> None:
        """Until `stop` is set. Raises EchogridError where a bus or the publisher cannot be opened."""
        with ExitStack() as opened:
            metrics, regions = self._open(opened)
            workers = [threading.Thread(target=self._receive, args=(bus,), name=bus.bus.name) for bus in self.buses]
            workers.append(threading.Thread(target=self._publish, args=(metrics,), name="publisher"))
            workers.append(threading.Thread(target=self._beside, args=(regions.run,), name="regions"))
            if self.keeper is not None:
                workers.append(threading.Thread(target=self._beside, args=(self.keeper.run,), name="keeper"))
            if self.recorder is not None:
                workers.append(threading.Thread(target=self._beside, args=(self.recorder.run,), name="recorder"))
            for worker in workers:
                worker.start()
            self.live.set()
            log.info("inverse sensor model: %s", self.pipeline.model.why)
            buses = ", ".join(f"{bus.name} ({bus.interface} {bus.channel})" for bus in self.config.bus)
            log.info("live on %s", buses)
            self.notifier.ready(f"live on {buses}; no map yet")
            try:
                self._map()
            finally:
                self.notifier.stopping()
                self.stop.set()
                for worker in workers:
                    worker.join()
        if self.failure is not None:
            raise self.failure

    def _open(self, opened: ExitStack) -> tuple[Metrics, Regions]:
        """Everything that leads outside; what is wrong names the configuration's file."""
        try:
            path = store_path(self.config)
            if path is not None:
                self.keeper = opened.enter_context(self.pipeline.keep(path, time.time_ns(), self.map_lock))
            publisher = opened.enter_context(Publisher(self.config.publish, self.config.vehicle, self.config.ros))
            self.sinks.append(publisher)
            reader = MapReader(self.pipeline.mapper, self.map_lock, self.keeper)
            regions = Regions(publisher, self.config.grid.cell, reader)
            metrics = opened.enter_context(Metrics(self.config.metrics, self.config.vehicle))
            for bus in self.config.bus:
                self.buses.append(LiveBus(bus, self.pipeline.signals.ids(bus.name)))
                opened.callback(self.buses[-1].close)
        except EchogridError as error:
            raise EchogridError(f"{self.pipeline.signals.source}: {error}") from error
        if self.foxglove is not None:
            view = opened.enter_context(Foxglove(*self.foxglove, self.config.vehicle))
            self.sinks.append(view)
            log.info("live for Foxglove on ws://%s:%d", self.foxglove[0], view.port)
        if self.record is not None:
            self.recorder = McapRecorder(self.record)
            opened.callback(self.recorder.close)
            self.sinks.append(self.recorder)
        return metrics, regions

    def state(self) -> State:
        """Of the map, now. The traffic's own time goes on by the monotonic clock, so that no step of another one matters."""
        state = self.pipeline.state(round((time.monotonic() - self.mapped_at) * 1e9))
        if self.lag > MOST_LAG and state.name in ("ok", "degraded"):
            return State("stale", (f"mapping: {self.lag:.1f} s behind the buses", *state.reasons))
        return state

    def status(self) -> dict[str, Any]:
        """What goes out as status: the state of the map, how the service keeps up, and all counters."""
        state = self.state()
        latencies = np.array(self.latencies) * 1e3
        p50, p99 = np.percentile(latencies, (50, 99)).tolist() if len(latencies) else (None, None)
        return {
            "state": state.name,
            "reasons": state.reasons,
            "epoch": self.pipeline.mapper.epoch,
            "model": self.pipeline.model.why,
            "buses": {bus.bus.name: asdict(bus.refresh()) for bus in self.buses},
            "rates": self.rates.per_second(maps=self.pipeline.health.cycles, frames=self.pipeline.health.frames),
            "latency_ms": {"p50": p50, "p99": p99},
            "dropped_frames": self.queue.dropped,
            "dropped_motion": self.queue.dropped_motion,
            "store": None if self.keeper is None else asdict(self.keeper.status),
            "recording": None if self.recorder is None else asdict(self.recorder.recording),
            "rss_mib": resident_mib(),
            **asdict(self.pipeline.health),
        }

    def reload(self, config: Config) -> None:
        """Takes over what of another configuration needs no restart. Raises EchogridError naming what does."""
        kept = {key: getattr(config.publish, key) for key in RELOADABLE}
        asked = msgspec.structs.replace(self.config, publish=msgspec.structs.replace(self.config.publish, **kept))
        if asked != config:
            keys = ", ".join(key for key in config.__struct_fields__ if getattr(config, key) != getattr(asked, key))
            raise EchogridError(f"{keys}: only {' and '.join(RELOADABLE)} of [publish] can change without a restart")
        self.config = config

    def _map(self) -> None:
        while not self.stop.is_set():
            self.turned_at = time.monotonic()
            item = self.queue.get(timeout=WAIT)
            if item is None:
                continue
            bus, message, received_at = item
            if self.recorder is not None:
                self.recorder.frame(bus, message)
            with self.map_lock:
                update = self.add(bus, message)
                self.mapped_at = time.monotonic()
                self.lag = self.mapped_at - received_at
                if update is None:
                    continue
                self.latencies.append(time.monotonic() - received_at)
                snapshot = self.snapshots.take(self.pipeline.mapper, update, self.config.publish)
            if snapshot is not None:
                self.outbox.put(snapshot)

    def _beside(self, run: Callable[[threading.Event], None]) -> None:
        try:
            run(self.stop)
        except Exception as error:  # no fault of a disk or of whoever asks, which they survive
            self.failure = error
            self.stop.set()

    def _receive(self, bus: LiveBus) -> None:
        try:
            while not self.stop.is_set():
                message = bus.recv(timeout=WAIT)
                if message is not None:
                    self.queue.put(bus.bus.name, message)
        except Exception as error:  # no fault of the bus, which LiveBus survives: the service must not go on deaf
            self.failure = error
            self.stop.set()

    def _publish(self, metrics: Metrics) -> None:
        """The map as it comes, status once a second. A subscriber that is slow costs nothing but its own messages."""
        announcer = Announcer(self.config, self.pipeline.model.why)

        def tell(status: dict[str, Any]) -> None:
            self._send(announcer.status(status, time.time_ns()))
            metrics.update(status)

        status_due = meta_due = time.monotonic()
        try:
            while not self.stop.is_set():
                if time.monotonic() >= meta_due:
                    self._send((announcer.meta(time.time_ns()),))
                    meta_due += META_PERIOD
                snapshot = self.outbox.get(timeout=WAIT)
                if snapshot is not None:
                    self._send(announcer.map(snapshot))
                    self.notifier.alive()
                if time.monotonic() >= status_due:
                    status = self.status()
                    tell(status)
                    self._tell_systemd(status)
                    status_due += STATUS_PERIOD
            tell({**self.status(), "state": "stopped", "reasons": ()})
        except Exception as error:  # whatever Zenoh raises: the service must not go on unseen
            self.failure = error
            self.stop.set()

    def _send(self, messages: Iterable[Message]) -> None:
        """To all sinks; one that can take no more is told of and left out."""
        for message in messages:
            for sink in tuple(self.sinks):
                try:
                    sink.put(message)
                except EchogridError as error:
                    self.sinks.remove(sink)
                    log.error(f"{error}; going on without it")  # each is told

    def _tell_systemd(self, status: dict[str, Any]) -> None:
        """The journal of a change of state, the manager of the rates. Its watchdog is fed by maps that went out; where none had to,
        because no scan came that could be placed, by the mapping's coming round."""
        state, now = State(status["state"], status["reasons"]), time.monotonic()
        if self.told is None or state.name != self.told.name:
            before = "" if self.told is None else f" after {now - self.told_at:.0f} s {self.told.name}"
            level = logging.INFO if state.name == "ok" or self.told is None else logging.WARNING  # at the start there is no map yet
            log.log(level, "; ".join((f"state {state.name}{before}", *state.reasons)))  # a sentence of its own, never held back as a repeat
            self.told, self.told_at = state, now
        rates = status["rates"]
        told = (f"{state.name}", f"{rates['map_hz']:.1f} maps/s, {rates['frames_hz']:.0f} frames/s", *state.reasons)
        self.notifier.status("; ".join(told))
        if rates["map_hz"] == 0 and now - self.turned_at < TURNING:
            self.notifier.alive()

    def _is_motion(self, bus: str, message: can.Message) -> bool:
        frame_id = (message.arbitration_id, message.is_extended_id)
        return isinstance(self.pipeline.signals.readers.get((bus, frame_id)), MotionReader)


class _Outbox:
    """Room for one snapshot: a newer one replaces it."""

    def __init__(self) -> None:
        self._newest: Snapshot | None = None
        self._filled = threading.Condition()

    def put(self, snapshot: Snapshot) -> None:
        with self._filled:
            self._newest = snapshot
            self._filled.notify()

    def get(self, timeout: float) -> Snapshot | None:
        """The newest snapshot, once; None after `timeout` seconds."""
        with self._filled:
            if self._newest is None:
                self._filled.wait(timeout)
            newest, self._newest = self._newest, None
            return newest


class _Rates:
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
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / (1 << 20)


def run(config_path: Path, model: str | None = None, record: Path | None = None, foxglove: tuple[str, int] | None = None) -> None:
    """`echogrid run`: until SIGTERM or SIGINT; SIGHUP reads the configuration again. Raises EchogridError.

    `record`: an MCAP file, or a folder, where it is named by the time of the start; `foxglove`: host and port of a live view.
    """
    if record is not None and record.is_dir():
        record /= time.strftime("%Y%m%dT%H%M%SZ.mcap", time.gmtime())
    service = Service(Pipeline(load_config(config_path, model), config_path), record=record, foxglove=foxglove)

    def reload() -> None:  # in the mapping's thread, between two frames
        service.notifier.reloading()
        try:
            service.reload(load_config(config_path, model))
            log.info(f"{config_path} was read again: {service.config.publish}")
        except EchogridError as error:
            log.error(f"not reloaded, going on as before: {error}")  # each refusal is told
        service.notifier.ready("reloaded")

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: service.stop.set())
    signal.signal(signal.SIGHUP, lambda *_: reload())
    service.run()
    log.info("stopped after %d cycles", service.pipeline.health.cycles)
