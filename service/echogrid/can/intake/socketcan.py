"""Frames out of a SocketCAN socket, all that wait in one system call, with the kernel's times."""

from __future__ import annotations

import ctypes
import errno
import math
import os
import socket
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import FrameBatch, channel_number
from echogrid.core.kernels.can_frames import CLASSIC, FLEXIBLE, HEAD, LENGTH, STAMP, STAMP_BYTES
from echogrid.core.kernels.dispatch import loops

_KINDS = frozenset((CLASSIC, FLEXIBLE))  # sizes of frames
# Of 64-bit Linux: struct mmsghdr, and struct iovec.
_HEADER = np.dtype(
    {
        "names": ["iov", "iovlen", "control", "controllen"],
        "formats": ["u8", "u8", "u8", "u8"],
        "offsets": [16, 24, 32, 40],
        "itemsize": 4 * HEAD,
    }
)
_PART = np.dtype([("base", "u8"), ("size", "u8")])
# Called with the interpreter's lock held: it never waits, and to give the lock away costs more than the call.
_recvmmsg = ctypes.PyDLL(None, use_errno=True).recvmmsg
_recvmmsg.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_void_p)


class Inbox:
    """A socket, and room for what is taken of it at once, at most `most` frames; the same each time.

    `reads` turns true once it has been read without a fault: an interface that is down can be opened, but not read.
    """

    def __init__(self, opened: socket.socket, most: int) -> None:
        self.reads = False
        self._opened = opened
        self._most = most
        self._rows = np.zeros((most, FLEXIBLE), np.uint8)
        self._begins = np.arange(most, dtype=np.int64) * FLEXIBLE + 8
        self._stamps = np.zeros((most, STAMP), np.int64)
        parts, headers = np.zeros(most, _PART), np.zeros(most, _HEADER)
        parts["base"], parts["size"] = _addresses(self._rows), FLEXIBLE
        headers["iov"], headers["iovlen"] = _addresses(parts), 1
        headers["control"], headers["controllen"] = _addresses(self._stamps), STAMP_BYTES
        self._parts, self._address = parts, headers.ctypes.data
        self._heads = headers.view(np.int32).reshape(most, HEAD)

    def fileno(self) -> int:
        """Readable while there is something to take."""
        return self._opened.fileno()

    def close(self) -> None:
        """Nothing: who opened the socket closes it."""

    def take(self, channel: str | int | None) -> FrameBatch | None:
        """The frames that are there, as of `channel`; None where there are none. Never waits. Raises OSError.

        A frame without a time of the kernel's has that of its receipt.
        """
        count = _recvmmsg(self._opened.fileno(), self._address, self._most, socket.MSG_DONTWAIT, None)
        if count < 0:
            code = ctypes.get_errno()
            if code == errno.EAGAIN:
                self.reads = True
                return None
            raise OSError(code, os.strerror(code))
        self.reads = True
        heads = self._heads[:count]
        lengths = heads[:, LENGTH].tolist()
        times, ids, data = np.empty(count), np.empty(count, np.uint32), np.empty(count * FLEXIBLE, np.uint8)
        flags, dlc, there = np.empty((3, count), np.uint8)
        loops.can_frames(self._rows[:count], heads, self._stamps[:count], times, ids, flags, dlc, there, data)
        if math.isnan(times.min()):
            times[np.isnan(times)] = time.time()
        names: dict[str, int] = {}
        channels = np.full(count, channel_number(channel, names), np.int32)
        batch = FrameBatch(times, ids, flags, dlc, there, self._begins[:count], data, channels, tuple(names))
        if _KINDS.issuperset(lengths):
            return batch
        batch = batch.where(np.isin(lengths, tuple(_KINDS)))
        return batch if len(batch) else None


def _addresses(pieces: NDArray[Any]) -> NDArray[np.uint64]:
    """(N,) where in memory each of them begins."""
    return pieces.ctypes.data + np.arange(len(pieces), dtype=np.uint64) * pieces.strides[0]
