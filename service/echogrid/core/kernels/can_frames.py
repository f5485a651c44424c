"""The reference's way to read frames as Linux has them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.cells import Bytes, Floats, Integers, Places

EXTENDED, REMOTE, ERROR, FD, SENT, SWITCH, STATE = (1 << bit for bit in range(7))  # among a frame's flags
CLASSIC, FLEXIBLE = 16, 72  # bytes
FIRST_NAME = -2  # of channels with names: -2 is the first name, -3 the second
# linux/can.h: struct canfd_frame, of which struct can_frame has the first 16 bytes.
_FRAME = np.dtype([("id", "=u4"), ("length", "u1"), ("flags", "u1"), ("", "V2"), ("data", "u1", (64,))])
_EFF, _RTR, _ERR = 0x80000000, 0x40000000, 0x20000000
_BRS, _ESI = 1, 2


# Of 64-bit Linux: struct mmsghdr as 16 integers, of which these say of a frame how many bytes of control data it has,
# its flags and its bytes; and struct cmsghdr with a struct timespec behind it as 4, the last two of which are s and ns.
HEAD, CONTROLS, FLAGS, LENGTH = 16, 10, 12, 14
STAMP, STAMP_BYTES = 4, 32
_DONTROUTE = 4  # sys/socket.h MSG_DONTROUTE: sent by this machine


def can_frames(
    rows: Bytes,
    heads: Places,
    stamps: Integers,
    times: Floats,
    ids: NDArray[np.uint32],
    flags: Bytes,
    dlc: Bytes,
    sizes: Bytes,
    data: Bytes,
) -> None:
    """Of frames (N, FLEXIBLE) of a socket, which came as CLASSIC or FLEXIBLE bytes with heads (N, HEAD) and stamps (N, STAMP): times in s,
    NaN without a stamp, ids, flags, bytes announced and bytes there, (N,) each, and all bytes (N * FLEXIBLE,). `rows` and `heads` are then
    as before the frames came."""
    frames = rows.view(_FRAME)[:, 0]
    codes, is_fd, sent = frames["id"], heads[:, LENGTH] != CLASSIC, heads[:, FLAGS] & _DONTROUTE != 0
    extended, remote = codes & _EFF != 0, codes & _RTR != 0
    times[:] = np.where(heads[:, CONTROLS] < STAMP_BYTES, np.nan, stamps[:, 2] + stamps[:, 3] * 1e-9)
    ids[:] = np.where(extended, codes & 0x1FFFFFFF, codes & 0x7FF)
    dlc[:] = np.minimum(frames["length"], np.where(is_fd, 64, 8))
    sizes[:] = np.where(remote, 0, dlc)
    flags[:] = extended * EXTENDED | remote * REMOTE | (codes & _ERR != 0) * ERROR | is_fd * FD | sent * SENT
    flags |= ((is_fd & (frames["flags"] & _BRS != 0)) * SWITCH | (is_fd & (frames["flags"] & _ESI != 0)) * STATE).astype(np.uint8)
    data[:] = rows.reshape(-1)
    rows[:] = 0  # a shorter frame has nothing of a longer one behind it
    heads[:, CONTROLS] = STAMP_BYTES


def join_frames(
    order: Integers,
    starts: Integers,
    behind: Integers,
    stamps: list[Floats],
    ids: list[NDArray[np.uint32]],
    flags: list[Bytes],
    dlc: list[Bytes],
    sizes: list[Bytes],
    begins: list[Integers],
    channels: list[Places],
    all_stamps: Floats,
    all_ids: NDArray[np.uint32],
    all_flags: Bytes,
    all_dlc: Bytes,
    all_sizes: Bytes,
    all_begins: Integers,
    all_channels: Places,
    batch: Integers,
) -> None:
    """The columns of K batches as one, of N frames, in an `order` (N,) of the frames batch by batch; and which batch each is of.

    `starts` (K,): frames before each batch. `behind` (2, K): what is added to the `begins` of each, and to those of its `channels` that
    are names.
    """
    batch[:] = np.searchsorted(starts, order, side="right") - 1
    shifted = [one + more for one, more in zip(begins, behind[0], strict=True)]
    named = [np.where(one <= FIRST_NAME, one + more, one) for one, more in zip(channels, behind[1], strict=True)]
    whole: tuple[NDArray[Any], ...] = (all_stamps, all_ids, all_flags, all_dlc, all_sizes, all_begins, all_channels)
    for some, column in zip((stamps, ids, flags, dlc, sizes, shifted, named), whole, strict=True):
        column[:] = np.concatenate(some)[order]
