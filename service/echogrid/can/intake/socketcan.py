"""Frames out of a SocketCAN socket, all that wait in one system call, with the kernel's times."""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import time

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import FrameBatch, channel_number
from echogrid.core.kernels.can_frames import CLASSIC, FLEXIBLE
from echogrid.core.kernels.dispatch import loops

SO_TIMESTAMPNS = 35  # asm-generic/socket.h
# Of 64-bit Linux: struct mmsghdr, struct iovec, and struct cmsghdr with the struct timespec behind it.
_HEADER = np.dtype(
    {
        "names": ["iov", "iovlen", "control", "controllen", "flags", "size"],
        "formats": ["u8", "u8", "u8", "u8", "i4", "u4"],
        "offsets": [16, 24, 32, 40, 48, 56],
        "itemsize": 64,
    }
)
_PART = np.dtype([("base", "u8"), ("size", "u8")])
_STAMP = np.dtype([("size", "u8"), ("level", "i4"), ("type", "i4"), ("seconds", "i8"), ("nanoseconds", "i8")])
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
        self._rows = np.zeros((most, FLEXIBLE), np.uint8)
        self._stamps = np.zeros(most, _STAMP)
        self._parts = np.zeros(most, _PART)
        self._parts["base"] = self._rows.ctypes.data + np.arange(most, dtype=np.uint64) * FLEXIBLE
        self._parts["size"] = FLEXIBLE
        self._headers = np.zeros(most, _HEADER)
        self._headers["iov"] = self._parts.ctypes.data + np.arange(most, dtype=np.uint64) * _PART.itemsize
        self._headers["iovlen"] = 1
        self._headers["control"] = self._stamps.ctypes.data + np.arange(most, dtype=np.uint64) * _STAMP.itemsize
        self._headers["controllen"] = _STAMP.itemsize

    def fileno(self) -> int:
        """Readable while there is something to take."""
        return self._opened.fileno()

    def close(self) -> None:
        """Nothing: who opened the socket closes it."""

    def take(self, channel: str | int | None) -> FrameBatch | None:
        """The frames that are there, as of `channel`; None where there are none. Never waits. Raises OSError.

        A frame without a time of the kernel's has that of its receipt.
        """
        count = _recvmmsg(self._opened.fileno(), self._headers.ctypes.data, len(self._headers), socket.MSG_DONTWAIT, None)
        if count < 0:
            code = ctypes.get_errno()
            if code == errno.EAGAIN:
                self.reads = True
                return None
            raise OSError(code, os.strerror(code))
        self.reads = True
        headers, stamps = self._headers[:count], self._stamps[:count]
        sizes = headers["size"].astype(np.uint8)
        sent = headers["flags"] & socket.MSG_DONTROUTE != 0
        rows = self._rows[:count].copy()
        times = stamps["seconds"] + stamps["nanoseconds"] * 1e-9
        unstamped = (headers["controllen"] < _STAMP.itemsize) | (stamps["type"] != SO_TIMESTAMPNS)
        if unstamped.any():
            times[unstamped] = time.time()
        self._rows[:count] = 0  # a shorter frame has nothing of a longer one behind it
        headers["controllen"] = _STAMP.itemsize
        frames = (sizes == CLASSIC) | (sizes == FLEXIBLE)
        if not frames.all():
            rows, sizes, sent, times = rows[frames], sizes[frames], sent[frames], times[frames]
            if not len(rows):
                return None
        return _batch(rows, sizes, sent, times, channel)


def _batch(
    rows: NDArray[np.uint8], sizes: NDArray[np.uint8], sent: NDArray[np.bool_], times: NDArray[np.float64], channel: str | int | None
) -> FrameBatch:
    """Of frames (N, FLEXIBLE) as the kernel has them."""
    count = len(rows)
    ids, (flags, dlc, there) = np.empty(count, np.uint32), np.empty((3, count), np.uint8)
    loops.can_frames(rows, sizes, sent, ids, flags, dlc, there)
    names: dict[str, int] = {}
    channels = np.full(count, channel_number(channel, names), np.int32)
    begins = np.arange(count, dtype=np.int64) * FLEXIBLE + 8
    return FrameBatch(times, ids, flags, dlc, there, begins, rows.reshape(-1), channels, tuple(names))
