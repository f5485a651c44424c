"""Live CAN buses through python-can: opened, read, and reopened after they went away."""

from __future__ import annotations

import errno
import logging
import select
import socket
import struct
import threading
import time
import traceback
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import can
import numpy as np
from can.interfaces.socketcan import SocketcanBus
from numpy.typing import NDArray

from echogrid.can.database import FrameId
from echogrid.can.intake.frames import ERROR, FrameBatch
from echogrid.can.intake.socketcan import Inbox
from echogrid.can.intake.watched import Watched
from echogrid.config.tables import Bus
from echogrid.errors import EchogridError

log = logging.getLogger("echogrid")

GATHER = 0.0005  # s from the first frame to the taking of all: those close behind it cost little more
MOST = 512  # frames that are received at once
MOST_GARBLED = 100  # frames one after the other, and the bus is taken for lost
PATIENCE = 2.0  # s for a driver to come back from what it does when its bus is closed
FIRST_PAUSE, LONGEST_PAUSE = 0.25, 4.0  # s between attempts to open a lost bus
# linux/sock_diag.h: SO_MEMINFO's ninth number is what the kernel threw away because the buffer was full, as SO_RXQ_OVFL reports it.
SO_MEMINFO, MEMINFO, DROPS = 55, struct.Struct("=9I"), 8
CAN_ERR_BUSOFF = 0x40  # linux/can/error.h, in an error frame's id


@dataclass(slots=True)
class BusHealth:
    """One bus since the start of the service."""

    frames: int = 0
    errors: int = 0  # error frames of the controller, and frames that its interface could not make out
    bus_off: int = 0  # those among them that say that it left the bus
    overflow: int = 0  # frames that the kernel dropped because they were not taken out of the receive buffer in time
    reconnects: int = 0
    up: bool = False  # open, and no fault since its last frame


class LiveBus:
    """A CAN bus, to be selected on while it is open. An interface that goes down, is unplugged or leaves the bus is tried again until it
    is back, by the thread that calls `bring_back`; of all else, one thread does one thing at a time."""

    def __init__(self, bus: Bus, ids: list[FrameId]) -> None:
        """Passes only `ids`, all frames where there are none. Raises EchogridError where it cannot be opened at all."""
        self.bus = bus
        self.ids = ids
        self.health = BusHealth()
        self._opened: can.BusABC | None = open_bus(bus, ids)
        self._source: Inbox | Watched | None = _source(self._opened)  # None from a fault until it is opened again
        self._faulty: Inbox | Watched | None = None  # the one with the fault, until who brings the bus back closes it, which may wait
        self._overflow_before = 0  # of the sockets that were closed
        self._lost = False
        self._garbled = 0  # without a frame between
        self._pause = FIRST_PAUSE
        self._retry_at = 0.0  # time.monotonic()
        self.health.up = True

    @property
    def is_open(self) -> bool:
        """Whether it can be selected on."""
        return self._source is not None

    def fileno(self) -> int:
        """Readable while there are frames, or a fault to be found. Only of one that is open."""
        assert self._source is not None
        return self._source.fileno()

    def take(self) -> FrameBatch | None:
        """The data frames that are there, at most MOST, whose channel is that of a log: not every interface says it, and a recording is to
        be one. Never waits. None where there are none, or error frames alone, and while the bus is away."""
        source = self._source
        if source is None:
            return None
        try:
            batch = source.take(self.bus.logged_as)
        except (can.CanError, OSError) as error:
            self._lose(error)
            return None
        except Exception as error:  # what an interface of python-can's makes of a frame that is garbled
            self._garble(error)
            return None
        if self._lost and source.reads:
            self._back()
        if batch is None:
            return None
        self._garbled = 0
        self.health.frames += len(batch)
        failed = batch.flags & ERROR != 0
        if not failed[-1]:
            self.health.up = True
        if failed.any():
            self._note(batch.ids[failed], sound_last=not failed[-1])
            batch = batch.where(~failed)
        return batch if len(batch) else None

    def bring_back(self) -> None:
        """Closes it, which may wait for its driver, and opens it again, where it was lost and it is time to try."""
        if self._source is not None or time.monotonic() < self._retry_at:
            return
        self.close()
        try:
            self._opened = open_bus(self.bus, self.ids)
        except EchogridError:
            self._wait_longer()
        else:
            self._source = _source(self._opened)

    def refresh(self) -> BusHealth:
        """The counters, the kernel's overflow among them. For another thread too: no counter goes back while the bus is closed."""
        self.health.overflow = max(self.health.overflow, self._overflow_before + _dropped_by_kernel(self._opened))
        return self.health

    def close(self) -> None:
        """At once, or after PATIENCE with a driver that does not come back, which is left behind. A second time does nothing."""
        if self._opened is None:
            return
        opened, self._opened = self._opened, None
        self._overflow_before += _dropped_by_kernel(opened)
        sources, self._source, self._faulty = (self._source, self._faulty), None, None
        ending = threading.Thread(target=_end, args=(opened, sources), name="end", daemon=True)
        ending.start()
        ending.join(PATIENCE)
        if ending.is_alive():
            said = "bus '%s': the driver of %s channel '%s' does not come back: it is not closed in good order"
            log.warning(said, self.bus.name, self.bus.interface, self.bus.channel)

    def _note(self, codes: NDArray[np.uint32], *, sound_last: bool) -> None:
        """Error frames, by their ids; a bus that was left is up again if a sound frame came last."""
        self.health.errors += len(codes)
        off = int(np.count_nonzero(codes & CAN_ERR_BUSOFF))
        if off:
            self.health.bus_off += off
            self.health.up = sound_last
            log.warning("bus '%s': %s is bus-off", self.bus.name, self.bus.channel)

    def _lose(self, error: Exception) -> None:
        self._garbled = 0
        if not self._lost:
            log.warning("bus '%s': %s channel '%s' was lost: %s; trying again", self.bus.name, self.bus.interface, self.bus.channel, error)
        self._lost, self.health.up = True, False
        self._wait_longer()
        self._faulty, self._source = self._source, None

    def _garble(self, error: Exception) -> None:
        said = "bus '%s': %s makes no frame of what it received: %s; each is counted in errors"
        log.warning(said, self.bus.name, self.bus.interface, error)
        self.health.errors += 1
        self._garbled += 1
        if self._garbled == MOST_GARBLED:
            self._lose(error)

    def _wait_longer(self) -> None:
        self._retry_at = time.monotonic() + self._pause
        self._pause = min(2 * self._pause, LONGEST_PAUSE)

    def _back(self) -> None:
        """A read without a fault."""
        self._lost, self._pause, self.health.up = False, FIRST_PAUSE, True
        self.health.reconnects += 1
        log.warning("bus '%s': %s channel '%s' is back", self.bus.name, self.bus.interface, self.bus.channel)


def _end(opened: can.BusABC, sources: Iterable[Inbox | Watched | None]) -> None:
    """May wait for the driver, and for ever."""
    for source in sources:
        if source is not None:
            source.close()
    with suppress(Exception):  # what a driver raises of a device that is gone: it need not be closed in good order
        opened.shutdown()


def wait(buses: Sequence[LiveBus], timeout: float) -> None:
    """Until something can be taken of one that is open, and a moment longer for what comes close behind it; at most `timeout` s."""
    if select.select([bus for bus in buses if bus.is_open], [], [], timeout)[0]:
        time.sleep(GATHER)


def _dropped_by_kernel(opened: can.BusABC | None) -> int:
    if not isinstance(opened, SocketcanBus):
        return 0
    try:
        return int(MEMINFO.unpack(opened.socket.getsockopt(socket.SOL_SOCKET, SO_MEMINFO, MEMINFO.size))[DROPS])
    except (OSError, ValueError, struct.error):  # closed meanwhile
        return 0


def _source(opened: can.BusABC) -> Inbox | Watched:
    return Inbox(opened.socket, MOST) if isinstance(opened, SocketcanBus) else Watched(opened, MOST)


def open_bus(bus: Bus, ids: list[FrameId]) -> can.BusABC:
    """Opens a bus that passes only these ids, in the kernel where the interface can; all frames where there are none.

    Raises EchogridError.
    """
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
        _close_sockets(error)
        raise EchogridError(f"bus '{bus.name}': {bus.interface} channel '{bus.channel}' cannot be opened: {_why(bus, error)}") from error
    if isinstance(opened, SocketcanBus):
        _enlarge(opened.socket, bus)
    return opened


def _close_sockets(error: Exception) -> None:
    """Those of a bus that could not be opened: python-can leaves them to the garbage collector, and only the traceback has the bus."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        made = frame.f_locals.get("self")
        for held in vars(made).values() if isinstance(made, can.BusABC) else ():
            if isinstance(held, socket.socket):
                held.close()


def _why(bus: Bus, error: Exception) -> str:
    """What an interface raised, in words that say what is missing."""
    number = error.errno if isinstance(error, OSError) else None
    if bus.interface == "socketcan" and number in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
        return "this kernel has no SocketCAN, or has not loaded it: modprobe can_raw (vcan for virtual buses), or another interface"
    if bus.interface == "socketcan" and number == errno.ENODEV:
        names = [name for _, name in socket.if_nameindex() if name != "lo"]
        return f"there is no such network interface, found {', '.join(names) or 'none'}"
    if isinstance(error, NameError):  # of a driver's library that could not be loaded, which python-can only logs
        return f"the driver's library is not there ({error})"
    return str(error)


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
