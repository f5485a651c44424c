"""What comes in: the buses, a thread each, and the queue that they fill."""

from __future__ import annotations

import threading
from contextlib import ExitStack

import can

from echogrid.can.bus import LiveBus
from echogrid.can.frame_queue import FrameQueue
from echogrid.can.motion import MotionReader
from echogrid.can.pose import PoseReader
from echogrid.can.signals import SignalReader
from echogrid.config.tables import Bus
from echogrid.live.workers import WAIT

QUEUE_FRAMES = 4096  # one to two seconds of four radars


class Receiving:
    """Remembers the open buses and the frames that wait for the mapping."""

    def __init__(self, signals: SignalReader) -> None:
        self.buses: list[LiveBus] = []
        self.queue = FrameQueue(QUEUE_FRAMES, self._is_motion)
        self._signals = signals

    def open(self, buses: tuple[Bus, ...], opened: ExitStack) -> None:
        """Opens all, to be closed by `opened`. Raises EchogridError naming the one that cannot be opened."""
        for bus in buses:
            self.buses.append(LiveBus(bus, self._signals.ids(bus.name)))
            opened.callback(self.buses[-1].close)

    def run(self, bus: LiveBus, stop: threading.Event) -> None:
        """One bus's thread."""
        while not stop.is_set():
            message = bus.recv(timeout=WAIT)
            if message is not None:
                self.queue.put(bus.bus.name, message)

    def _is_motion(self, bus: str, message: can.Message) -> bool:
        frame_id = (message.arbitration_id, message.is_extended_id)
        return isinstance(self._signals.readers.get((bus, frame_id)), MotionReader | PoseReader)
