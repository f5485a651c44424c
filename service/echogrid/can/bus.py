"""Live CAN buses through python-can: opened, read, and reopened after they went away."""

from __future__ import annotations

import logging
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import can
import numpy as np
from can.interfaces.socketcan import SocketcanBus
from numpy.typing import NDArray

from echogrid.can.intake import socketcan
from echogrid.can.intake.frames import ERROR, FrameBatch
from echogrid.can.radar import FrameId
from echogrid.config.tables import Bus
from echogrid.errors import EchogridError

log = logging.getLogger("echogrid")

GATHER = 0.0005  # s
MOST = 512  # frames that are received at once
FIRST_PAUSE, LONGEST_PAUSE = 0.25, 4.0  # s between attempts to open a lost bus
# linux/sock_diag.h: SO_MEMINFO's ninth number is what the kernel threw away because the buffer was full, as SO_RXQ_OVFL reports it.
SO_MEMINFO, MEMINFO, DROPS = 55, struct.Struct("=9I"), 8
CAN_ERR_BUSOFF = 0x40  # linux/can/error.h, in an error frame's id


@dataclass(slots=True)
class BusHealth:
    """One bus since the start of the service."""

    frames: int = 0
    errors: int = 0  # error frames of the controller
    bus_off: int = 0  # those among them that say that it left the bus
    overflow: int = 0  # frames that the kernel dropped because they were not taken out of the receive buffer in time
    reconnects: int = 0
    up: bool = False  # open, and no fault since its last frame


class LiveBus:
    """A CAN bus that only one thread reads. An interface that goes down, is unplugged or leaves the bus is tried again until it is back."""

    def __init__(self, bus: Bus, ids: list[FrameId]) -> None:
        """Passes only `ids`, in the kernel where the interface can. Raises EchogridError where it cannot be opened at all."""
        self.bus = bus
        self.ids = ids
        self.health = BusHealth()
        self._opened: can.BusABC | None = open_bus(bus, ids)
        self._overflow_before = 0  # of the sockets that were closed
        self._lost = False
        self._pause = FIRST_PAUSE
        self._retry_at = 0.0  # time.monotonic()
        self.health.up = True

    def receive(self, timeout: float, gather: Callable[[], None] = lambda: time.sleep(GATHER)) -> FrameBatch | None:
        """The next data frames: the first that comes, and those that come while `gather` waits, which cost little more than one.

        None after `timeout` seconds without any, where there are error frames alone, and while the bus is away.
        """
        if self._opened is None and not self._open_again(timeout):
            return None
        assert self._opened is not None
        try:
            batch = self._received(self._opened, timeout, gather)
        except (can.CanError, OSError) as error:
            self._lose(error)
            return None
        if self._lost:
            self._back()
        if batch is None:
            return None
        self.health.frames += len(batch)
        failed = batch.flags & ERROR != 0
        if not failed[-1]:
            self.health.up = True
        if failed.any():
            self._note(batch.ids[failed], sound_last=not failed[-1])
            batch = batch.where(~failed)
        return batch if len(batch) else None

    def _received(self, opened: can.BusABC, timeout: float, gather: Callable[[], None]) -> FrameBatch | None:
        """All frames of one look, whose channel is that of a log: not every interface says it, and a recording is to be one."""
        if isinstance(opened, SocketcanBus):
            if not select.select([opened.socket], [], [], timeout)[0]:
                return None
            gather()
            return socketcan.receive(opened.socket, MOST, self.bus.logged_as)
        messages: list[can.Message] = []
        message = opened.recv(timeout)
        if message is not None:
            gather()
        while message is not None:
            message.channel = self.bus.logged_as
            messages.append(message)
            message = opened.recv(0) if len(messages) < MOST else None
        return FrameBatch.of(messages) if messages else None

    def refresh(self) -> BusHealth:
        """The counters, the kernel's overflow among them."""
        self.health.overflow = self._overflow_before + self._dropped_by_kernel()
        return self.health

    def close(self) -> None:
        """A second time does nothing."""
        if self._opened is not None:
            self._overflow_before += self._dropped_by_kernel()
            opened, self._opened = self._opened, None
            opened.shutdown()

    def _note(self, codes: NDArray[np.uint32], *, sound_last: bool) -> None:
        """Error frames, by their ids; a bus that was left is up again if a sound frame came last."""
        self.health.errors += len(codes)
        off = int(np.count_nonzero(codes & CAN_ERR_BUSOFF))
        if off:
            self.health.bus_off += off
            self.health.up = sound_last
            log.warning("bus '%s': %s is bus-off", self.bus.name, self.bus.channel)

    def _lose(self, error: Exception) -> None:
        if not self._lost:
            log.warning("bus '%s': %s channel '%s' was lost: %s; trying again", self.bus.name, self.bus.interface, self.bus.channel, error)
        self._lost, self.health.up = True, False
        self._wait()
        try:
            self.close()
        except (can.CanError, OSError):  # a device that is gone need not be closed in good order
            self._opened = None

    def _wait(self) -> None:
        self._retry_at = time.monotonic() + self._pause
        self._pause = min(2 * self._pause, LONGEST_PAUSE)

    def _open_again(self, timeout: float) -> bool:
        left = self._retry_at - time.monotonic()
        if left > 0:
            time.sleep(min(left, timeout))
            return False
        try:
            self._opened = open_bus(self.bus, self.ids)
        except EchogridError:
            self._wait()
            return False
        return True

    def _back(self) -> None:
        """A read without a fault: an interface that is down can be opened, but not read."""
        self._lost, self._pause, self.health.up = False, FIRST_PAUSE, True
        self.health.reconnects += 1
        log.warning("bus '%s': %s channel '%s' is back", self.bus.name, self.bus.interface, self.bus.channel)

    def _dropped_by_kernel(self) -> int:
        opened = self._opened
        if not isinstance(opened, SocketcanBus):
            return 0
        try:
            return int(MEMINFO.unpack(opened.socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO.size))[DROPS])
        except (OSError, ValueError, struct.error):  # closed by the reading thread meanwhile
            return 0


def open_bus(bus: Bus, ids: list[FrameId]) -> can.BusABC:
    """Opens a bus that passes only the ids that are read (in the kernel where the interface can). Raises EchogridError."""
    filters = [{"can_id": number, "can_mask": 0x1FFFFFFF if extended else 0x7FF, "extended": extended} for number, extended in ids]
    options: dict[str, Any] = {"interface": bus.interface, "channel": bus.channel, "can_filters": filters, "fd": bus.fd}
    for key in ("bitrate", "data_bitrate"):
        if getattr(bus, key) is not None:
            options[key] = getattr(bus, key)
    if bus.interface == "virtual":
        # Replays in one process: the times are the log's own, not those of the sending.
        options = {"interface": "virtual", "channel": bus.channel, "can_filters": filters, "preserve_timestamps": True}
        options["protocol"] = can.CanProtocol.CAN_FD if bus.fd else can.CanProtocol.CAN_20
    try:
        opened = can.Bus(**options, ignore_config=True)  # the configuration is this file alone, not ~/.canrc
    except Exception as error:  # each of python-can's interfaces raises what its driver raises
        raise EchogridError(f"bus '{bus.name}': {bus.interface} channel '{bus.channel}' cannot be opened: {error}") from error
    if isinstance(opened, SocketcanBus):
        _enlarge(opened.socket, bus)
    return opened


def _enlarge(opened: socket.socket, bus: Bus) -> None:
    """The kernel's receive buffer; it gives no more than net.core.rmem_max, and doubles what it gives for its own bookkeeping."""
    wanted = bus.receive_buffer_kib << 10
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted)
    given = opened.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
    if given < wanted:
        log.warning(
            "bus '%s': receive buffer of %d KiB given, %d KiB asked for; more with: sysctl -w net.core.rmem_max=%d",
            bus.name,
            given >> 10,
            bus.receive_buffer_kib,
            wanted,
        )
