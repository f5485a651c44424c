"""What comes in: the buses, which the thread that maps reads, and the queue of what it has not mapped yet."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack

from echogrid.can.bus import MOST, LiveBus, wait
from echogrid.can.frame_queue import FrameQueue, Item
from echogrid.can.signals import SignalReader
from echogrid.config.tables import Bus
from echogrid.live.pace import LONGEST, Pace
from echogrid.threads import WAIT

QUEUE_FRAMES = 4096  # one to two seconds of four radars


class Receiving:
    """Remembers the open buses and the frames that wait for the mapping.

    The thread that maps calls `look` and reads all buses itself: handed on from one thread to another, a frame would cost more than it
    does now. Another one runs `guard`, which reads them where the mapping takes so long that the buffers of kernel and drivers would
    overflow, and brings back buses that were lost.
    """

    def __init__(self, signals: SignalReader) -> None:
        self.buses: list[LiveBus] = []
        self.queue = FrameQueue(QUEUE_FRAMES, signals.are_motion)
        self.pace = Pace()
        self._signals = signals
        self._lock = threading.Lock()  # held by who reads, or takes what was read
        self._busy_since: float | None = None  # time.monotonic() when the mapping was given frames; None while it waits for them
        self._left = False  # more frames wait than one look takes

    def open(self, buses: tuple[Bus, ...], opened: ExitStack) -> None:
        """Opens all, to be closed by `opened`. Raises EchogridError naming the one that cannot be opened."""
        for bus in buses:
            self.buses.append(LiveBus(bus, self._signals.ids(bus.name)))
            opened.callback(self.buses[-1].close)

    def look(self, timeout: float) -> list[Item]:
        """What all buses have had since the last look, if that is not much: when it is due, and if it was due already as soon as there is
        anything. Empty where there was nothing then, or nothing came for `timeout` seconds."""
        self._busy_since = None
        if len(self.queue) == 0 and (self._left or not self.pace.rest()):
            wait(self.buses, timeout)
        with self._lock:
            self._busy_since = self._read()
            return self.queue.take(MOST)

    def guard(self, stop: threading.Event) -> None:
        """Until `stop`."""
        while not stop.wait(WAIT):
            with self._lock:
                if self._busy_since is not None and time.monotonic() - self._busy_since > LONGEST:
                    self._read()
            for bus in self.buses:
                bus.bring_back()

    def _read(self) -> float:
        """All buses, once; when that was, by time.monotonic()."""
        read = [(bus.bus.name, batch) for bus in self.buses if (batch := bus.take()) is not None]
        now = time.monotonic()
        for name, batch in read:
            self.queue.put(name, batch, now)
        self._left = any(len(batch) == MOST for _, batch in read)
        return now
