"""What comes in: the buses, a thread each, and the queue that they fill."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from functools import partial

from echogrid.can.bus import MOST, LiveBus
from echogrid.can.frame_queue import FrameQueue
from echogrid.can.signals import SignalReader
from echogrid.config.tables import Bus
from echogrid.live.pace import Pace
from echogrid.threads import WAIT

QUEUE_FRAMES = 4096  # one to two seconds of four radars


class Receiving:
    """Remembers the open buses and the frames that wait for the mapping."""

    def __init__(self, signals: SignalReader) -> None:
        self.buses: list[LiveBus] = []
        self.queue = FrameQueue(QUEUE_FRAMES, signals.are_motion)
        self.pace = Pace()
        self._signals = signals

    def open(self, buses: tuple[Bus, ...], opened: ExitStack) -> None:
        """Opens all, to be closed by `opened`. Raises EchogridError naming the one that cannot be opened."""
        for bus in buses:
            self.buses.append(LiveBus(bus, self._signals.ids(bus.name)))
            opened.callback(self.buses[-1].close)

    def run(self, bus: LiveBus, stop: threading.Event) -> None:
        """One bus's thread."""
        name = bus.bus.name
        while not stop.is_set():
            batch = bus.receive(WAIT, partial(self.pace.wait, name))
            if batch is not None:
                self.queue.put(name, batch)
            self.pace.looked(name, again=batch is None or len(batch) == MOST)
