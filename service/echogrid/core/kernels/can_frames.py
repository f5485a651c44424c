"""The reference's way to read frames as Linux has them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.cells import Bytes, Mask

EXTENDED, REMOTE, ERROR, FD, SENT, SWITCH, STATE = (1 << bit for bit in range(7))  # among a frame's flags
CLASSIC, FLEXIBLE = 16, 72  # bytes
# linux/can.h: struct canfd_frame, of which struct can_frame has the first 16 bytes.
_FRAME = np.dtype([("id", "=u4"), ("length", "u1"), ("flags", "u1"), ("", "V2"), ("data", "u1", (64,))])
_EFF, _RTR, _ERR = 0x80000000, 0x40000000, 0x20000000
_BRS, _ESI = 1, 2


def can_frames(rows: Bytes, lengths: Bytes, sent: Mask, ids: NDArray[np.uint32], flags: Bytes, dlc: Bytes, sizes: Bytes) -> None:
    """Ids, flags, bytes announced and bytes there of frames (N, 72), which came as CLASSIC or FLEXIBLE bytes, or were `sent` here."""
    frames = rows.view(_FRAME)[:, 0]
    codes, is_fd = frames["id"], lengths != CLASSIC
    extended, remote = codes & _EFF != 0, codes & _RTR != 0
    ids[:] = np.where(extended, codes & 0x1FFFFFFF, codes & 0x7FF)
    dlc[:] = np.minimum(frames["length"], np.where(is_fd, 64, 8))
    sizes[:] = np.where(remote, 0, dlc)
    flags[:] = extended * EXTENDED | remote * REMOTE | (codes & _ERR != 0) * ERROR | is_fd * FD | sent * SENT
    flags |= ((is_fd & (frames["flags"] & _BRS != 0)) * SWITCH | (is_fd & (frames["flags"] & _ESI != 0)) * STATE).astype(np.uint8)
