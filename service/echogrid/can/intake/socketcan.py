"""Frames out of a SocketCAN socket, all that wait at once, with the kernel's times."""

from __future__ import annotations

import socket
import struct
import time

import numpy as np

from echogrid.can.intake.frames import ERROR, EXTENDED, FD, REMOTE, SENT, STATE, SWITCH, FrameBatch, channel_number

# linux/can.h: struct canfd_frame, of which struct can_frame has the first 16 bytes.
_FRAME = np.dtype([("id", "=u4"), ("length", "u1"), ("flags", "u1"), ("", "V2"), ("data", "u1", (64,))])
CLASSIC, FLEXIBLE = 16, 72  # bytes
EFF, RTR, ERR = 0x80000000, 0x40000000, 0x20000000
BRS, ESI = 1, 2
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
    frames = np.frombuffer(b"".join(parts), _FRAME)
    codes, is_fd = frames["id"], np.array(sizes) == FLEXIBLE
    extended, remote = codes & EFF != 0, codes & RTR != 0
    flags_of_all = extended * np.uint8(EXTENDED) | remote * np.uint8(REMOTE) | (codes & ERR != 0) * np.uint8(ERROR)
    flags_of_all |= is_fd * np.uint8(FD) | np.array(sent) * np.uint8(SENT)
    flags_of_all |= (is_fd & (frames["flags"] & BRS != 0)) * np.uint8(SWITCH) | (is_fd & (frames["flags"] & ESI != 0)) * np.uint8(STATE)
    lengths = np.minimum(frames["length"], np.where(is_fd, 64, 8)).astype(np.uint8)
    names: dict[str, int] = {}
    number = channel_number(channel, names)
    return FrameBatch(
        np.array(stamps),
        np.where(extended, codes & 0x1FFFFFFF, codes & 0x7FF).astype(np.uint32),
        flags_of_all,
        lengths,
        np.where(remote, 0, lengths).astype(np.uint8),
        np.arange(len(frames), dtype=np.int64) * FLEXIBLE + 8,
        frames.view(np.uint8),
        np.full(len(frames), number, np.int32),
        tuple(names),
    )
