"""Frames out of a SocketCAN socket, all that wait at once, with the kernel's times."""

from __future__ import annotations

import socket
import struct
import time

import numpy as np

from echogrid.can.intake.frames import FrameBatch, channel_number
from echogrid.core.kernels.can_frames import CLASSIC, FLEXIBLE
from echogrid.core.kernels.dispatch import loops

_TIME = struct.Struct("@ll")  # struct timespec of SO_TIMESTAMPNS
_ROOM = socket.CMSG_SPACE(_TIME.size)


def receive(opened: socket.socket, most: int, channel: str | int | None) -> FrameBatch | None:
    """The frames that wait, at most so many; None where there are none. Raises OSError.

    A frame without a time of the kernel's has that of its receipt.
    """
    parts: list[bytes] = []
    stamps: list[float] = []
    sizes: list[int] = []
    sent: list[bool] = []
    try:
        while len(parts) < most:
            data, ancillary, flags, _ = opened.recvmsg(FLEXIBLE, _ROOM, socket.MSG_DONTWAIT)
            if len(data) not in (CLASSIC, FLEXIBLE):
                continue
            parts.append(data.ljust(FLEXIBLE, b"\0"))
            sizes.append(len(data))
            sent.append(flags & socket.MSG_DONTROUTE != 0)
            if ancillary:
                seconds, nanoseconds = _TIME.unpack_from(ancillary[0][2])
                stamps.append(seconds + nanoseconds * 1e-9)
            else:
                stamps.append(time.time())
    except BlockingIOError:
        pass
    if not parts:
        return None
    count = len(parts)
    rows = np.frombuffer(b"".join(parts), np.uint8).reshape(count, FLEXIBLE)
    ids, (flags_of_all, dlc, there) = np.empty(count, np.uint32), np.empty((3, count), np.uint8)
    loops.can_frames(rows, np.array(sizes, np.uint8), np.array(sent, np.bool_), ids, flags_of_all, dlc, there)
    names: dict[str, int] = {}
    number = channel_number(channel, names)
    begins = np.arange(count, dtype=np.int64) * FLEXIBLE + 8
    channels = np.full(count, number, np.int32)
    return FrameBatch(np.array(stamps), ids, flags_of_all, dlc, there, begins, rows.reshape(-1), channels, tuple(names))
