"""A recording in place of the car: its frames on buses of this process, from which the service receives them as from any bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

import can
import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import FrameBatch
from echogrid.can.signals import bus_of, buses_of
from echogrid.config.tables import Config
from echogrid.errors import EchogridError
from echogrid.live.service import Service
from echogrid.logs.log import Log

AHEAD_FRAMES = 512  # the player waits when the service is so far behind: nothing is lost, however slow the machine
APART = 0.05  # s of the recording: buses have threads of their own, and none gets farther ahead of another
PATIENCE = 20.0  # s
LINGER = 0.3  # s for the last window to reach subscribers

See = Callable[[FrameBatch, NDArray[np.int64]], None]


def on_virtual_buses(config: Config) -> Config:
    """The same configuration on python-can's in-process buses."""
    return msgspec.structs.replace(config, bus=tuple(msgspec.structs.replace(bus, interface="virtual") for bus in config.bus))


def senders(config: Config) -> dict[str, can.BusABC]:
    """Of `on_virtual_buses`, by the buses' names: the other end, which sends messages with their own time stamps."""
    fd = can.CanProtocol.CAN_FD  # it takes classic frames too
    return {
        bus.name: can.Bus(interface="virtual", channel=bus.channel, preserve_timestamps=True, protocol=fd, ignore_config=True)
        for bus in config.bus
    }


class Player:
    """Remembers how many frames it sent, and when the first. `run` is for a thread of its own, best one of the service's workers."""

    def __init__(
        self,
        service: Service,
        log: Log,
        *,
        speed: float | None = None,
        see: See | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> None:
        """`speed`: times the recording's own pace; None is as fast as the service maps. `see` is told of all frames and their
        buses, those that nobody reads too, before they are sent."""
        self.sent = 0
        self.ended = False  # whether the recording was played to its end, or as far as it can be read
        self.torn: EchogridError | None = None  # why it could not be read to its end
        self._service = service
        self._log = log
        self._speed = speed
        self._see = see
        self._on_progress = on_progress
        self._first: tuple[float, float] | None = None  # the first frame's time in the recording, and by the monotonic clock

    def run(self, stop: threading.Event) -> None:
        """Plays, waits until all is mapped and sets `stop`, or ends early because it was set. Raises EchogridError where the service gets
        no further."""
        self._service.receiving.pace.rests = self._speed == 1.0
        self._service.live.wait(PATIENCE)
        config, readers = self._service.config, self._service.pipeline.signals.readers
        buses = senders(config)
        level = 0.0  # s: the recording's time when all buses were last as far as each other
        try:
            for message in self._messages():
                bus = bus_of(message, config.bus)
                if message.is_error_frame or (bus, (message.arbitration_id, message.is_extended_id)) not in readers:
                    continue  # the service's filter would not let it through: it could not be waited for
                self._wait_until_due(message.timestamp, stop)
                if len(buses) > 1 and abs(message.timestamp - level) > APART:
                    self._wait_for(self.sent, stop)
                    level = message.timestamp
                if stop.is_set():
                    return
                if not message.is_remote_frame:
                    message.dlc = len(message.data)  # no bus carries a frame that announces more, as files may have it
                buses[str(bus)].send(message)
                self.sent += 1
                self._wait_for(self.sent - AHEAD_FRAMES, stop)
                if self._on_progress is not None and self.sent % 256 == 0:
                    self._on_progress(self._log.progress)
        finally:
            for opened in buses.values():
                opened.shutdown()
        self.ended = True
        self._wait_for(self.sent, stop)
        stop.wait(LINGER)
        stop.set()

    def _messages(self) -> Iterator[can.Message]:
        """Those of the recording that can be read."""
        try:
            for batch in self._log.batches():
                if self._see is not None:
                    self._see(batch, buses_of(batch, self._service.config.bus))
                yield from batch
        except EchogridError as error:
            self.torn = error

    def _wait_until_due(self, at: float, stop: threading.Event) -> None:
        if self._speed is None:
            return
        if self._first is None:
            self._first = at, time.monotonic()
        first, began = self._first
        ahead = (at - first) / self._speed - (time.monotonic() - began)
        if ahead > 0:
            stop.wait(ahead)

    def _wait_for(self, frames: int, stop: threading.Event) -> None:
        """Waits until the service has received so many frames. Raises EchogridError if it gets no further."""
        health = self._service.pipeline.health
        seen, deadline = health.frames, time.monotonic() + PATIENCE
        while health.frames < frames and not stop.is_set():
            time.sleep(0.001)
            if health.frames > seen:
                seen, deadline = health.frames, time.monotonic() + PATIENCE
            elif time.monotonic() > deadline:
                raise EchogridError(f"the service received {seen} frames, then none for {PATIENCE:.0f} s")
