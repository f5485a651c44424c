"""The service: buses, mapping and publishing introduced to each other. The only place with threads and signals."""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import can

from echogrid.config import Bus, load_config
from echogrid.core.mapper import MapUpdate
from echogrid.core.odometry import EgoState
from echogrid.core.tiled_map import LogOdds
from echogrid.errors import EchogridError
from echogrid.io.bus import open_bus
from echogrid.io.frame_queue import FrameQueue
from echogrid.io.motion import MotionReader
from echogrid.io.publisher import Publisher
from echogrid.pipeline import Pipeline

log = logging.getLogger("echogrid")
QUEUE_FRAMES = 8192  # a few seconds of four radars
STATUS_PERIOD = 1.0  # s
STALE_AFTER = 1.0  # s without a map update


class Service:
    """One thread per bus receives, the caller's thread maps, one thread publishes; none waits for another.

    `add` takes each message to the pipeline; a recorder may stand in for it. `stop` ends the service at its next look.
    """

    def __init__(self, pipeline: Pipeline, add: Callable[[str, can.Message], MapUpdate | None] | None = None) -> None:
        self.pipeline = pipeline
        self.config = pipeline.config
        self.add = add or pipeline.add
        self.stop = threading.Event()
        self.live = threading.Event()  # all buses are open and the publisher is up
        self.queue = FrameQueue(QUEUE_FRAMES, self._is_motion)
        self.outbox = _Outbox()
        self.failure: Exception | None = None
        self.updated_at: float | None = None  # time.monotonic() of the newest update

    def run(self) -> None:
        """Until `stop` is set. Raises EchogridError where a bus or the publisher cannot be opened, or a bus is lost."""
        with ExitStack() as opened:
            publisher, buses = self._open(opened)
            workers = [threading.Thread(target=self._receive, args=pair, name=pair[0].name) for pair in buses]
            workers.append(threading.Thread(target=self._publish, args=(publisher,), name="publisher"))
            for worker in workers:
                worker.start()
            self.live.set()
            log.info("inverse sensor model: %s", self.pipeline.model.why)
            log.info("live on %s", ", ".join(f"{bus.name} ({bus.interface} {bus.channel})" for bus in self.config.bus))
            try:
                self._map()
            finally:
                self.stop.set()
                for worker in workers:
                    worker.join()
        if self.failure is not None:
            raise self.failure

    def _open(self, opened: ExitStack) -> tuple[Publisher, list[tuple[Bus, can.BusABC]]]:
        """Everything that leads outside; what is wrong names the configuration's file."""
        buses = []
        try:
            publisher = opened.enter_context(Publisher(self.config.publish, self.config.vehicle))
            for bus in self.config.bus:
                opened_bus = open_bus(bus, self.pipeline.signals.ids(bus.name))
                opened.callback(opened_bus.shutdown)
                buses.append((bus, opened_bus))
        except EchogridError as error:
            raise EchogridError(f"{self.pipeline.signals.source}: {error}") from error
        return publisher, buses

    def status(self) -> dict[str, Any]:
        """What goes out as status: the state of the map and all counters."""
        silence = None if self.updated_at is None else time.monotonic() - self.updated_at
        state = "waiting" if silence is None else "ok" if silence < STALE_AFTER else "stale"
        return {"state": state, "model": self.pipeline.model.why, "dropped_frames": self.queue.dropped, **asdict(self.pipeline.health)}

    def _map(self) -> None:
        period_ns = round(1e9 / self.config.publish.rate_hz)
        published_ns: int | None = None
        while not self.stop.is_set():
            item = self.queue.get(timeout=0.1)
            update = None if item is None else self.add(*item)
            if update is None:
                continue
            self.updated_at = time.monotonic()
            if published_ns is None or update.ego.stamp_ns - published_ns >= period_ns:
                published_ns = update.ego.stamp_ns
                around = self.pipeline.mapper.map.around(update.ego.odom_from_base, self.config.publish.window_cells)
                self.outbox.put(update.ego, *around)

    def _receive(self, bus: Bus, opened: can.BusABC) -> None:
        try:
            while not self.stop.is_set():
                message = opened.recv(timeout=0.1)
                if message is not None:
                    self.queue.put(bus.name, message)
        except (can.CanError, OSError) as error:
            self.failure = EchogridError(f"bus '{bus.name}': {bus.interface} channel '{bus.channel}' was lost: {error}")
            self.stop.set()

    def _publish(self, publisher: Publisher) -> None:
        """Grids as they come, status once a second. A subscriber that is slow costs nothing but its own grids."""
        status_due = time.monotonic()
        cell = self.config.grid.cell
        try:
            while not self.stop.is_set():
                newest = self.outbox.get(timeout=0.1)
                if newest is not None:
                    ego, row, column, log_odds = newest
                    publisher.grid(ego.stamp_ns, row, column, cell, log_odds)
                    publisher.odometry(ego)
                if time.monotonic() >= status_due:
                    publisher.status(self.status())
                    status_due += STATUS_PERIOD
        except Exception as error:  # whatever Zenoh raises: the service must not go on unseen
            self.failure = error
            self.stop.set()

    def _is_motion(self, bus: str, message: can.Message) -> bool:
        frame_id = (message.arbitration_id, message.is_extended_id)
        return isinstance(self.pipeline.signals.readers.get((bus, frame_id)), MotionReader)


class _Outbox:
    """Room for one map window: a newer one replaces it."""

    def __init__(self) -> None:
        self._newest: tuple[EgoState, int, int, LogOdds] | None = None
        self._filled = threading.Condition()

    def put(self, ego: EgoState, row: int, column: int, log_odds: LogOdds) -> None:
        with self._filled:
            self._newest = (ego, row, column, log_odds)
            self._filled.notify()

    def get(self, timeout: float) -> tuple[EgoState, int, int, LogOdds] | None:
        """The newest window, once; None after `timeout` seconds."""
        with self._filled:
            if self._newest is None:
                self._filled.wait(timeout)
            newest, self._newest = self._newest, None
            return newest


def run(config_path: Path, model: str | None = None) -> None:
    """`echogrid run`: until SIGTERM or SIGINT. Raises EchogridError."""
    service = Service(Pipeline(load_config(config_path, model), config_path))
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: service.stop.set())
    service.run()
    log.info("stopped after %d cycles", service.pipeline.health.cycles)
