"""Occupancy grids, and patches of them, as ROS's messages in CDR (`cdr`), and back."""

from __future__ import annotations

import math
import struct

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.topics.cdr import LITTLE_ENDIAN, aligned, body_of, encode_header, padded, read, read_header

_MAP_META_DATA = struct.Struct("<iIfII")  # map_load_time, resolution, width, height
_ORIGIN = struct.Struct("<7dI")  # position, orientation (x, y, z, w), length of data
_PATCH = struct.Struct("<iiIII")  # x, y, width, height, length of data


class Grid(msgspec.Struct, frozen=True, eq=False):
    """nav_msgs/OccupancyGrid, axis-parallel: cell [i, j] covers x from origin[0] + j * cell and y from origin[1] + i * cell on."""

    stamp_ns: int  # when it was measured
    frame: str
    cell: float  # m; float32 on the wire
    origin: tuple[float, float]  # m: x and y of the outer corner of cell [0, 0]
    occupancy: NDArray[np.int8]  # (H, W) percent, -1 where never seen; rows along y, columns along x

    @property
    def probability(self) -> NDArray[np.float32]:
        """p(occupied), (H, W) in [0, 1], NaN where never seen."""
        return np.where(self.occupancy < 0, np.float32(np.nan), self.occupancy / np.float32(100))


class GridUpdate(msgspec.Struct, frozen=True, eq=False):
    """map_msgs/OccupancyGridUpdate: cells [i, j] take the places [y + i, x + j] of a grid."""

    stamp_ns: int
    frame: str
    x: int  # column of the first cell in the grid
    y: int  # row
    occupancy: NDArray[np.int8]  # (H, W) percent, -1 where never seen; (0, 0) where nothing changes


def encode_grid(grid: Grid) -> bytes:
    """The grid as nav_msgs/msg/OccupancyGrid; map_load_time is 0."""
    height, width = grid.occupancy.shape
    head = encode_header(grid.stamp_ns, grid.frame) + _MAP_META_DATA.pack(0, 0, grid.cell, width, height)
    origin = _ORIGIN.pack(*grid.origin, 0.0, 0.0, 0.0, 0.0, 1.0, height * width)
    return b"".join((LITTLE_ENDIAN, padded(head, 8), origin, grid.occupancy.astype(np.int8, copy=False).tobytes()))


def decode_grid(payload: bytes) -> Grid:
    """The grid of a nav_msgs/msg/OccupancyGrid; its `occupancy` is a read-only view of the payload."""
    body = body_of(payload)
    stamp_ns, frame, at = read_header(body)
    _, _, cell, width, height = read(_MAP_META_DATA, body, at)
    at = aligned(at + _MAP_META_DATA.size, 8)
    x, y, *rest, count = read(_ORIGIN, body, at)
    at += _ORIGIN.size
    if count != len(body) - at or count != width * height:
        raise ValueError(f"a grid of {height} x {width} cells declares {count} and holds {len(body) - at}")
    if not (math.isfinite(cell) and cell > 0 and math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"a grid with cells of {cell} m at ({x}, {y}) is nowhere")
    if rest != [0.0, 0.0, 0.0, 0.0, 1.0]:
        raise ValueError("the grid is raised or rotated, expected it in its frame's plane and parallel to its axes")
    return Grid(stamp_ns, frame, cell, (x, y), _cells(body[at:], height, width))


def encode_update(update: GridUpdate) -> bytes:
    """The update as map_msgs/msg/OccupancyGridUpdate."""
    height, width = update.occupancy.shape
    head = encode_header(update.stamp_ns, update.frame) + _PATCH.pack(update.x, update.y, width, height, height * width)
    return b"".join((LITTLE_ENDIAN, head, update.occupancy.astype(np.int8, copy=False).tobytes()))


def decode_update(payload: bytes) -> GridUpdate:
    """The update of a map_msgs/msg/OccupancyGridUpdate; its `occupancy` is a read-only view of the payload."""
    body = body_of(payload)
    stamp_ns, frame, at = read_header(body)
    x, y, width, height, count = read(_PATCH, body, at)
    at += _PATCH.size
    if count != len(body) - at or count != width * height:
        raise ValueError(f"an update of {height} x {width} cells declares {count} and holds {len(body) - at}")
    if x < 0 or y < 0:
        raise ValueError(f"an update of the cells from row {y} and column {x} on is outside its grid")
    return GridUpdate(stamp_ns, frame, x, y, _cells(body[at:], height, width))


def _cells(data: memoryview, height: int, width: int) -> NDArray[np.int8]:
    occupancy = np.frombuffer(data, dtype=np.int8).reshape(height, width)
    if occupancy.size and (occupancy.min() < -1 or occupancy.max() > 100):
        raise ValueError("the grid has cells outside -1 ... 100 percent")
    return occupancy
