"""Frames of an interface that has nothing to select on: a thread waits for them, and rings."""

from __future__ import annotations

import os
import threading

import can

from echogrid.can.intake.frames import FrameBatch
from echogrid.threads import WAIT


class Watched:
    """A bus whose thread waits for the first frame; who takes it takes those behind it too, and so lets the thread wait again.

    `reads` turns true once the interface has been read without a fault.
    """

    def __init__(self, bus: can.BusABC, most: int) -> None:
        self.reads = False
        self._bus = bus
        self._most = most
        self._bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._first: can.Message | None = None
        self._fault: Exception | None = None
        self._ended = False
        self._taken = threading.Semaphore(0)
        self._thread = threading.Thread(target=self._watch, name="watch", daemon=True)
        self._thread.start()

    def fileno(self) -> int:
        """Readable while there is something to take."""
        return self._bell

    def take(self, channel: str | int | None) -> FrameBatch | None:
        """The frames that are there, as of `channel`; None where there are none. Never waits. Raises, once, what the interface raised, and
        ValueError for what no bus carries."""
        try:
            os.eventfd_read(self._bell)
        except BlockingIOError:
            return None
        if self._fault is not None:
            fault, self._fault = self._fault, None
            self._taken.release()
            raise fault
        messages: list[can.Message] = []
        message = self._first
        while message is not None:
            message.channel = channel
            messages.append(message)
            message = self._received(0.0) if len(messages) < self._most else None
        if self._fault is None:
            self._taken.release()
        else:  # first what came before it
            os.eventfd_write(self._bell, 1)
        return FrameBatch.of(messages)

    def close(self) -> None:
        """Once the driver comes back, however long that takes. The interface itself stays open. Nothing is taken afterwards."""
        self._ended = True
        self._taken.release()
        self._thread.join()
        os.close(self._bell)

    def _watch(self) -> None:
        while not self._ended:
            self._first = self._received(WAIT)
            if self._first is not None or self._fault is not None:
                os.eventfd_write(self._bell, 1)
                self._taken.acquire()

    def _received(self, timeout: float) -> can.Message | None:
        try:
            message = self._bus.recv(timeout)
            if message is not None:
                _check(message)
        except Exception as fault:  # each of python-can's interfaces raises what its driver raises
            self._fault = fault
            return None
        self.reads = True
        return message


def _check(message: can.Message) -> None:
    """Raises ValueError for what no bus carries: a line of a serial adapter that lost some of its letters may still read as a frame."""
    if message.is_error_frame:
        return
    number, bits = message.arbitration_id, 29 if message.is_extended_id else 11
    if not 0 <= number < 1 << bits:
        raise ValueError(f"id {number:#x} found, expected one of {bits} bits")
    if len(message.data) < message.dlc and not message.is_remote_frame:
        raise ValueError(f"frame {number:#x} has {len(message.data)} of the {message.dlc} bytes that it announces")
