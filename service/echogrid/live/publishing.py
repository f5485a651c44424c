"""What goes out: maps as they come, status once a second, to every sink; the thread that publishes."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from echogrid.errors import EchogridError
from echogrid.live.manager import Manager
from echogrid.live.mapping import Outbox
from echogrid.topics.announcer import MAPPED, Announcer
from echogrid.topics.topic import Message, Sink, Topic

log = logging.getLogger("echogrid")
STATUS_PERIOD = 1.0  # s
META_PERIOD = 10.0  # s: late subscribers get the last one, except those who reach a router at the same moment as the service


class Publishing:
    """Remembers the sinks that still take messages. One thread runs `run`.

    A slow subscriber loses only its own messages; a sink that can take no more is logged and left out.
    """

    def __init__(self, announcer: Announcer, outbox: Outbox, status: Callable[[], dict[str, Any]]) -> None:
        """`status` is called once a second for the status that is published."""
        self.sinks: list[Sink] = []
        self._announcer = announcer
        self._outbox = outbox
        self._status = status

    def run(self, stop: threading.Event, manager: Manager, measure: Callable[[dict[str, Any]], None]) -> None:
        """Until `stop` is set. `measure` is given each status as well."""

        def tell(status: dict[str, Any]) -> None:
            self.send(self._announcer.status(status, time.time_ns(), self.wanted))
            measure(status)

        status_due = meta_due = time.monotonic()
        while not stop.is_set():
            if time.monotonic() >= meta_due:
                self.send((self._announcer.meta(time.time_ns()),))
                meta_due = _next(meta_due, META_PERIOD)
            snapshot = self._outbox.get(timeout=max(status_due - time.monotonic(), 0.0))
            if snapshot is not None:
                self.send(self._announcer.map(snapshot, self.wanted))
                manager.map_published()
            if time.monotonic() >= status_due:
                status = self._status()
                tell(status)
                manager.tell(status)
                status_due = _next(status_due, STATUS_PERIOD)
        tell({**self._status(), "state": "stopped", "reasons": ()})

    def wanted(self, *topics: Topic) -> bool:
        """Whether any sink takes any of the topics now."""
        return any(sink.wants(*topics) for sink in tuple(self.sinks))

    def listened(self) -> bool:
        """Whether any takes what the map becomes."""
        return self.wanted(*MAPPED)

    def send(self, messages: Iterable[Message]) -> None:
        """To all sinks, in this order."""
        for message in messages:
            for sink in tuple(self.sinks):
                try:
                    sink.put(message)
                except EchogridError as error:
                    self.sinks.remove(sink)
                    log.error(f"{error}; continuing without it")  # each is logged


def _next(due: float, period: float) -> float:
    """When it is due again: a process that was stopped for an hour has nothing to make up for."""
    now = time.monotonic()
    return due + period if due + period > now else now + period
