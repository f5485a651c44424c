"""A tile as bytes: what the column `data` of a store holds. docs/store.md is the format."""

from __future__ import annotations

import numpy as np
import zstandard

from echogrid.core.map.tile import SIDE, Tile, tile_bytes

LEVEL = 3  # of zstd


class Packer:
    """Remembers the room that one tile after the other is packed in: new room for each is twice the work."""

    def __init__(self) -> None:
        self._compressor = zstandard.ZstdCompressor(level=LEVEL, write_checksum=True)
        self._room = np.empty(0, np.uint8)

    def pack(self, tile: Tile) -> bytes:
        """A zstd frame with a checksum: layers, seen_s, radars, little endian, of each array all lowest bytes first, then all next ones."""
        size, first = tile_bytes(len(tile.layers)), 0
        if len(self._room) != size:
            self._room = np.empty(size, np.uint8)
        for array, kind in ((tile.layers, "<f4"), (tile.seen_s, "<u4"), (tile.radars, "<u2")):
            cells = array.astype(kind, copy=False).reshape(-1, 1).view(np.uint8)  # (N, W)
            self._room[first : first + cells.size].reshape(cells.shape[::-1])[:] = cells.T  # like bytes side by side: a seventh less
            first += cells.size
        return self._compressor.compress(self._room.data)


def unpacked(data: bytes, layers: int) -> Tile:
    """Raises ZstdError or ValueError where it is not what `Packer.pack` makes of a tile of so many layers."""
    size = tile_bytes(layers)
    if zstandard.frame_content_size(data) != size:
        raise ValueError(f"{zstandard.frame_content_size(data)} bytes found, expected {size}")
    raw = np.frombuffer(zstandard.ZstdDecompressor().decompress(data), np.uint8)
    cells, parts, first = SIDE * SIDE, [], 0
    for count, kind in ((layers * cells, "<f4"), (cells, "<u4"), (cells, "<u2")):
        width = np.dtype(kind).itemsize
        part = raw[first : first + count * width].reshape(width, count)
        parts.append(np.ascontiguousarray(part.T).view(kind).reshape(-1, SIDE, SIDE))
        first += count * width
    if not np.isfinite(parts[0]).all():
        raise ValueError("a layer holds a value that is not a finite number")
    return Tile(parts[0], parts[1][0], parts[2][0])
