"""What the server says to the page: binary frames, little endian, each beginning with its kind. page/wire.js reads them.

A frame that holds a JSON object is its kind and three zeros, then UTF-8. The others are described where they are made.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

SIDE = 32  # cells along a block's side
MOST_BLOCKS = 65_535  # of a frame

BlockKey = tuple[int, int]  # row and column of blocks: cell (i, j) of the map lies in block (i // SIDE, j // SIDE)


class Kind(IntEnum):
    """The first byte."""

    HELLO = 1  # JSON: what there is to see; again when that changes
    RESET = 2  # another map: cells, trails and points are forgotten
    BLOCKS = 3
    POSE = 4
    POINTS = 5
    STATUS = 6  # JSON: as published, and `parts` with the level of each
    TRAIL = 7
    CLOCK = 8  # JSON: where a recording is being played


class Plane(IntEnum):
    """What a block says of its cells."""

    OCCUPANCY = 0  # int8, percent, -1 where never seen
    SOURCE = 1  # uint8, 0 unknown, 1 learned, 2 measured
    SEEN = 2  # uint32, Unix time in s when it was last in view, 0 never
    TRUTH = 3  # int8, percent, -1 where not known


DTYPES: Mapping[Plane, np.dtype[Any]] = {
    Plane.OCCUPANCY: np.dtype("<i1"),
    Plane.SOURCE: np.dtype("<u1"),
    Plane.SEEN: np.dtype("<u4"),
    Plane.TRUTH: np.dtype("<i1"),
}
EMPTY: Mapping[Plane, int] = {Plane.OCCUPANCY: -1, Plane.SOURCE: 0, Plane.SEEN: 0, Plane.TRUTH: -1}
_BLOCKS = struct.Struct("<BBH")  # kind, plane, number of blocks
_POSE = struct.Struct("<B7xq5d")  # kind, stamp in ns, x and y in m, yaw in rad, speed in m/s, yaw rate in rad/s
_POINTS = struct.Struct("<B3xIq")  # kind, number of points, stamp in ns
_TRAIL = struct.Struct("<BB2xI")  # kind, 0 driven or 1 true, number of points


def document(kind: Kind, said: Mapping[str, Any]) -> bytes:
    """A frame that holds a JSON object."""
    return bytes((kind, 0, 0, 0)) + msgspec.json.encode(said)


def reset() -> bytes:
    return bytes((Kind.RESET, 0, 0, 0))


def blocks(plane: Plane, cells: Mapping[BlockKey, NDArray[Any]]) -> list[bytes]:
    """Frames of blocks (SIDE, SIDE): behind the head each one's row and column of blocks as int32, then the cells, row by row."""
    keys, frames = list(cells), []
    for first in range(0, len(keys), MOST_BLOCKS):
        some = keys[first : first + MOST_BLOCKS]
        data = (cells[key].astype(DTYPES[plane], copy=False).tobytes() for key in some)
        frames.append(b"".join((_BLOCKS.pack(Kind.BLOCKS, plane, len(some)), np.array(some, "<i4").tobytes(), *data)))
    return frames


def pose(stamp_ns: int, x: float, y: float, yaw: float, speed: float, yaw_rate: float) -> bytes:
    """Where the car is in odom."""
    return _POSE.pack(Kind.POSE, stamp_ns, x, y, yaw, speed, yaw_rate)


def points(stamp_ns: int, places: NDArray[np.float32], radars: NDArray[np.uint8], verdicts: NDArray[np.uint8]) -> bytes:
    """Detections: places (N, 2) in odom as float32, then the radar's number of each, then its verdict, as uint8."""
    head = _POINTS.pack(Kind.POINTS, len(places), stamp_ns)
    return b"".join((head, places.astype("<f4", copy=False).tobytes(), radars.tobytes(), verdicts.tobytes()))


def trail(places: Sequence[tuple[float, float]] | NDArray[Any], *, true: bool = False) -> bytes:
    """The line of base so far, (N, 2) m in odom as float32."""
    return _TRAIL.pack(Kind.TRAIL, true, len(places)) + np.asarray(places, "<f4").tobytes()
