"""A tile as bytes: what the column `data` of a store holds. docs/store.md is the format."""

from __future__ import annotations

import numpy as np
import zstandard

from echogrid.core.map.tile import SIDE, Tile, tile_bytes

LEVEL = 3  # of zstd


def encode(tile: Tile) -> bytes:
    """A zstd frame with a checksum: layers, seen_s and radars, little endian, of each array all lowest bytes first, then all next ones."""
    arrays = (tile.layers.astype("<f4", copy=False), tile.seen_s.astype("<u4", copy=False), tile.radars.astype("<u2", copy=False))
    planes = (array.reshape(-1, 1).view(np.uint8).T for array in arrays)  # like bytes side by side: a seventh less
    return zstandard.ZstdCompressor(level=LEVEL, write_checksum=True).compress(b"".join(plane.tobytes() for plane in planes))


def decode(data: bytes, layers: int) -> Tile:
    """Raises ZstdError or ValueError where it is not what `encode` makes of a tile of so many layers."""
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
