"""Grids and their patches against rosbags, byte for byte, and against bytes that mean harm."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.cdr_messages import CELLS, FRAMES, NAMES, NUMBERS, ROS, STAMPS, STORE, grid_of, patched, ros_header, ros_pose

from echogrid.topics.grids import Grid, GridUpdate, decode_grid, decode_update, encode_grid, encode_update

GRIDS = st.builds(
    Grid,
    stamp_ns=STAMPS,
    frame=NAMES,
    cell=st.floats(2**-10, 100, width=32),
    origin=st.tuples(NUMBERS, NUMBERS),
    occupancy=CELLS,
)
UPDATES = st.builds(GridUpdate, STAMPS, NAMES, st.integers(0, 2**31 - 1), st.integers(0, 2**31 - 1), CELLS)


def _ros_grid(grid: Grid) -> object:
    height, width = grid.occupancy.shape
    info = ROS["nav_msgs/msg/MapMetaData"](
        map_load_time=ROS["builtin_interfaces/msg/Time"](sec=0, nanosec=0),
        resolution=grid.cell,
        width=width,
        height=height,
        origin=ros_pose(*grid.origin, 0.0, 1.0),
    )
    header = ros_header(grid.stamp_ns, grid.frame)
    return ROS["nav_msgs/msg/OccupancyGrid"](header=header, info=info, data=grid.occupancy.ravel())


def _ros_update(update: GridUpdate) -> object:
    height, width = update.occupancy.shape
    header = ros_header(update.stamp_ns, update.frame)
    return ROS["map_msgs/msg/OccupancyGridUpdate"](header, update.x, update.y, width, height, update.occupancy.ravel())


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (3, 4), (4, 3), (128, 257)])
def test_grid_is_what_rosbags_writes(frame: str, shape: tuple[int, int]) -> None:
    grid = grid_of(frame, *shape)
    assert encode_grid(grid) == bytes(STORE.serialize_cdr(_ros_grid(grid), "nav_msgs/msg/OccupancyGrid"))


@given(UPDATES)
def test_update_is_what_rosbags_writes_and_comes_back(update: GridUpdate) -> None:
    payload = encode_update(update)
    assert payload == bytes(STORE.serialize_cdr(_ros_update(update), "map_msgs/msg/OccupancyGridUpdate"))
    back = decode_update(payload)
    assert (back.stamp_ns, back.frame, back.x, back.y) == (update.stamp_ns, update.frame, update.x, update.y)
    np.testing.assert_array_equal(back.occupancy, update.occupancy)


def test_data_begins_at_the_smallest_x_and_y_and_runs_along_x() -> None:
    """Where ROS puts a cell: data[row * width + column] at origin + (column, row) * resolution."""
    occupancy = np.full((3, 5), -1, dtype=np.int8)
    occupancy[2, 1] = 88
    message = STORE.deserialize_cdr(encode_grid(Grid(0, "odom", 0.5, (-1.0, 4.0), occupancy)), "nav_msgs/msg/OccupancyGrid")
    index = int(np.argmax(message.data))
    assert (message.info.width, message.info.height) == (5, 3)
    x = message.info.origin.position.x + index % message.info.width * message.info.resolution
    y = message.info.origin.position.y + index // message.info.width * message.info.resolution
    assert (x, y) == (-0.5, 5.0)


def test_a_slice_of_a_larger_array_is_written_in_its_own_order() -> None:
    whole = np.arange(100, dtype=np.int8).reshape(10, 10)
    for view in (whole[2:5, 3:9], whole[::2, ::3], whole.T):
        decoded = decode_grid(encode_grid(Grid(0, "odom", 1.0, (0.0, 0.0), view)))
        np.testing.assert_array_equal(decoded.occupancy, view)


@given(GRIDS)
def test_grid_round_trip(grid: Grid) -> None:
    back = decode_grid(encode_grid(grid))
    assert (back.stamp_ns, back.frame, back.cell, back.origin) == (grid.stamp_ns, grid.frame, grid.cell, grid.origin)
    assert back.occupancy.dtype == np.int8
    assert back.occupancy.shape == grid.occupancy.shape
    np.testing.assert_array_equal(back.occupancy, grid.occupancy)


def test_probability() -> None:
    grid = Grid(0, "odom", 1.0, (0.0, 0.0), np.array([[-1, 0], [50, 100]], dtype=np.int8))
    assert grid.probability.dtype == np.float32
    np.testing.assert_array_equal(grid.probability, np.array([[np.nan, 0], [0.5, 1]], dtype=np.float32))


# For the frame "odom": stamp 0, length 8, frame 12, map_load_time 20, resolution 28, width 32, height 36, position 40,
# orientation 64, count 96, data 100.
@pytest.mark.parametrize(
    ("at", "layout", "values", "message"),
    [
        (4, "<I", (10**9,), "ns beside"),
        (8, "<I", (0,), "name of 0 bytes"),
        (8, "<I", (2**32 - 1,), "name of 4294967295 bytes"),
        (13, "<B", (0,), "only NUL"),
        (13, "<B", (0xFF,), "not UTF-8"),
        (28, "<f", (math.nan,), "nowhere"),
        (28, "<f", (0,), "nowhere"),
        (40, "<d", (math.inf,), "nowhere"),
        (48, "<d", (math.nan,), "nowhere"),
        (56, "<d", (1,), "raised or rotated"),
        (88, "<d", (math.nan,), "raised or rotated"),
        (32, "<II", (2**32 - 1, 2**32 - 1), "declares 12"),
        (32, "<II", (3, 3), "declares 12"),
        (96, "<I", (2**32 - 1,), "declares 4294967295 and holds 12"),
        (100, "<b", (-2,), "outside"),
        (100, "<b", (101,), "outside"),
    ],
)
def test_a_grid_that_cannot_be_is_refused(at: int, layout: str, values: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        decode_grid(patched(encode_grid(grid_of()), at, layout, *values))


def test_a_grid_of_no_rows_and_billions_of_columns_costs_nothing() -> None:
    payload = patched(patched(encode_grid(grid_of())[: 4 + 100], 32, "<II", 2**32 - 1, 0), 96, "<I", 0)
    assert decode_grid(payload).occupancy.size == 0


# For the frame "odom": x 20, y 24, width 28, height 32, count 36, data 40.
@pytest.mark.parametrize(
    ("at", "layout", "values", "message"),
    [
        (20, "<i", (-1,), "outside its grid"),
        (24, "<i", (-(2**31),), "outside its grid"),
        (28, "<II", (2**32 - 1, 2**32 - 1), "declares 12"),
        (28, "<II", (3, 3), "declares 12"),
        (36, "<I", (2**32 - 1,), "declares 4294967295 and holds 12"),
        (40, "<b", (-2,), "outside -1"),
        (40, "<b", (101,), "outside -1"),
    ],
)
def test_an_update_that_cannot_be_is_refused(at: int, layout: str, values: tuple[float, ...], message: str) -> None:
    payload = encode_update(GridUpdate(5, "odom", 3, 4, grid_of().occupancy))
    with pytest.raises(ValueError, match=message):
        decode_update(patched(payload, at, layout, *values))
