"""Grids for slow links: now and then, coarser, compressed."""

from __future__ import annotations

import msgspec
import numpy as np
import zstandard

from echogrid.topics.grids import Grid, decode_grid, encode_grid
from echogrid.topics.topic import FLEET, Message

STEP = 25  # percent
LARGEST = 17 << 20  # bytes of the largest grid that is taken: 4096 x 4096 cells
LEVEL = 1  # zstd's: more costs several times as much and saves little


class Fleet:
    """Remembers when the last one was made from a whole window, by the traffic's own time."""

    def __init__(self, rate_hz: float) -> None:
        """`rate_hz` 0: none is ever due."""
        self.period_ns = round(1e9 / rate_hz) if rate_hz else None
        self.made_ns: int | None = None

    def due(self, stamp_ns: int) -> bool:
        return self.period_ns is not None and (self.made_ns is None or not 0 <= stamp_ns - self.made_ns < self.period_ns)

    def message(self, full: Message) -> Message:
        """Of a whole window."""
        self.made_ns = full.stamp_ns
        payload = compress(encode_grid(quantised(decode_grid(full.payload))))
        return Message(FLEET, payload, full.stamp_ns, full.epoch, 0)


def quantised(grid: Grid) -> Grid:
    """The same with every known cell rounded to 0, 25, 50, 75 or 100 percent."""
    known = (grid.occupancy + np.int8(STEP // 2)) // np.int8(STEP) * np.int8(STEP)
    return msgspec.structs.replace(grid, occupancy=np.where(grid.occupancy < 0, np.int8(-1), known))


def compress(payload: bytes) -> bytes:
    """A message in zstd."""
    return zstandard.ZstdCompressor(level=LEVEL).compress(payload)


def decompress(payload: bytes) -> bytes:
    """The message of one zstd frame that says its size. Raises ValueError for anything else, and for more than any grid of ours."""
    try:
        size = zstandard.frame_content_size(payload)
        if not 0 <= size <= LARGEST:
            raise ValueError(f"the zstd frame says that it holds {size} bytes, expected at most {LARGEST}")
        return zstandard.ZstdDecompressor().decompress(payload, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise ValueError(f"not a zstd frame: {error}") from error
