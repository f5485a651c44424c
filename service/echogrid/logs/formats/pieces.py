"""Many pieces of one buffer, cut out at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def pieces(data: bytes | bytearray, begins: NDArray[np.int64], lengths: NDArray[np.int64]) -> list[bytes]:
    """`data[begin : begin + length]` of each (N,), all within the data: all that are of one length in one go, of which frames have few."""
    found = np.full(len(begins), b"", object)
    for length in np.flatnonzero(np.bincount(lengths)).tolist():
        if not length:
            continue
        rows = np.ndarray(len(data) - length + 1, f"V{length}", data, strides=(1,))
        same = np.flatnonzero(lengths == length)
        found[same] = rows[begins[same]].astype(object)
    taken: list[bytes] = found.tolist()
    return taken
