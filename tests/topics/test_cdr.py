"""Our CDR against rosbags, byte for byte, and against bytes that mean harm."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from tests.support.places import DOCS

from echogrid.core.motion.se2 import SE2
from echogrid.topics import cdr

STORE = get_typestore(Stores.ROS2_HUMBLE)
UPDATE = "std_msgs/Header header\nint32 x\nint32 y\nuint32 width\nuint32 height\nint8[] data"  # no part of rosbags' own
STORE.register(get_types_from_msg(UPDATE, "map_msgs/msg/OccupancyGridUpdate"))
ROS = STORE.types

FRAMES = ("", "m", "ab", "map", "odom", "base_link", "straße/über")
NUMBERS = st.floats(-1e7, 1e7)
NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=("Cs",)), max_size=20)
STAMPS = st.integers(-(2**31) * cdr.SECOND, 2**31 * cdr.SECOND - 1)
COVARIANCES = st.lists(NUMBERS, min_size=36, max_size=36).map(lambda values: np.array(values).reshape(6, 6))
CELLS = st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(0, 2**32 - 1)).map(
    lambda shape: np.random.default_rng(shape[2]).integers(-1, 101, shape[:2], dtype=np.int8)
)
GRIDS = st.builds(
    cdr.Grid,
    stamp_ns=STAMPS,
    frame=NAMES,
    cell=st.floats(2**-10, 100, width=32),
    origin=st.tuples(NUMBERS, NUMBERS),
    occupancy=CELLS,
)
DIAGNOSTICS = st.builds(
    cdr.DiagnosticArray,
    stamp_ns=STAMPS,
    frame=NAMES,
    status=st.lists(
        st.builds(cdr.DiagnosticStatus, st.sampled_from(cdr.Level), NAMES, NAMES, NAMES, st.dictionaries(NAMES, NAMES, max_size=4)),
        max_size=4,
    ).map(tuple),
)
ODOMETRIES = st.builds(
    cdr.Odometry,
    stamp_ns=STAMPS,
    frame=NAMES,
    child_frame=NAMES,
    pose=st.builds(SE2, NUMBERS, NUMBERS, st.floats(-50, 50)),
    speed=NUMBERS,
    yaw_rate=NUMBERS,
    pose_covariance=COVARIANCES,
    twist_covariance=COVARIANCES,
)


UPDATES = st.builds(cdr.GridUpdate, STAMPS, NAMES, st.integers(0, 2**31 - 1), st.integers(0, 2**31 - 1), CELLS)
TRANSFORMS = st.lists(st.builds(cdr.Transform, STAMPS, NAMES, NAMES, st.builds(SE2, NUMBERS, NUMBERS, st.floats(-50, 50))), max_size=4)
POINTS = st.builds(
    cdr.Points,
    STAMPS,
    NAMES,
    st.lists(st.tuples(*[st.floats(-1e7, 1e7, width=32)] * 3), max_size=9).map(lambda rows: np.array(rows, np.float32).reshape(-1, 3)),
)


def _ros_header(stamp_ns: int, frame: str) -> object:
    stamp = ROS["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return ROS["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _ros_pose(x: float, y: float, z: float, w: float) -> object:
    point = ROS["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
    return ROS["geometry_msgs/msg/Pose"](position=point, orientation=ROS["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=z, w=w))


def _ros_grid(grid: cdr.Grid) -> object:
    height, width = grid.occupancy.shape
    info = ROS["nav_msgs/msg/MapMetaData"](
        map_load_time=ROS["builtin_interfaces/msg/Time"](sec=0, nanosec=0),
        resolution=grid.cell,
        width=width,
        height=height,
        origin=_ros_pose(*grid.origin, 0.0, 1.0),
    )
    header = _ros_header(grid.stamp_ns, grid.frame)
    return ROS["nav_msgs/msg/OccupancyGrid"](header=header, info=info, data=grid.occupancy.ravel())


def _ros_odometry(odometry: cdr.Odometry) -> object:
    pose, half = odometry.pose, odometry.pose.yaw / 2
    vector = ROS["geometry_msgs/msg/Vector3"]
    twist = ROS["geometry_msgs/msg/Twist"](linear=vector(odometry.speed, 0.0, 0.0), angular=vector(0.0, 0.0, odometry.yaw_rate))
    return ROS["nav_msgs/msg/Odometry"](
        header=_ros_header(odometry.stamp_ns, odometry.frame),
        child_frame_id=odometry.child_frame,
        pose=ROS["geometry_msgs/msg/PoseWithCovariance"](
            pose=_ros_pose(pose.x, pose.y, math.sin(half), math.cos(half)), covariance=odometry.pose_covariance.ravel()
        ),
        twist=ROS["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=odometry.twist_covariance.ravel()),
    )


def _ros_update(update: cdr.GridUpdate) -> object:
    height, width = update.occupancy.shape
    header = _ros_header(update.stamp_ns, update.frame)
    return ROS["map_msgs/msg/OccupancyGridUpdate"](header, update.x, update.y, width, height, update.occupancy.ravel())


def _ros_transforms(transforms: Sequence[cdr.Transform]) -> object:
    vector, quaternion = ROS["geometry_msgs/msg/Vector3"], ROS["geometry_msgs/msg/Quaternion"]
    stamped = []
    for transform in transforms:
        pose, half = transform.pose, transform.pose.yaw / 2
        place = ROS["geometry_msgs/msg/Transform"](vector(pose.x, pose.y, 0.0), quaternion(0.0, 0.0, math.sin(half), math.cos(half)))
        header = _ros_header(transform.stamp_ns, transform.frame)
        stamped.append(ROS["geometry_msgs/msg/TransformStamped"](header, transform.child_frame, place))
    return ROS["tf2_msgs/msg/TFMessage"](stamped)


def _ros_points(points: cdr.Points) -> object:
    float32 = ROS["sensor_msgs/msg/PointField"].FLOAT32
    fields = [ROS["sensor_msgs/msg/PointField"](name, offset, float32, 1) for name, offset in (("x", 0), ("y", 4), ("z", 8))]
    data = np.frombuffer(points.points.tobytes(), dtype=np.uint8)
    return ROS["sensor_msgs/msg/PointCloud2"](
        header=_ros_header(points.stamp_ns, points.frame),
        height=1,
        width=len(points.points),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=len(data),
        data=data,
        is_dense=True,
    )


def _ros_diagnostics(array: cdr.DiagnosticArray) -> object:
    pair = ROS["diagnostic_msgs/msg/KeyValue"]
    status = [
        ROS["diagnostic_msgs/msg/DiagnosticStatus"](
            level=int(status.level),
            name=status.name,
            message=status.message,
            hardware_id=status.hardware_id,
            values=[pair(key=key, value=value) for key, value in status.values.items()],
        )
        for status in array.status
    ]
    return ROS["diagnostic_msgs/msg/DiagnosticArray"](header=_ros_header(array.stamp_ns, array.frame), status=status)


def _grid(frame: str = "odom", height: int = 3, width: int = 4) -> cdr.Grid:
    occupancy = (np.arange(height * width, dtype=np.int64) % 102 - 1).astype(np.int8).reshape(height, width)
    return cdr.Grid(1_700_000_000_123_456_789, frame, 0.234375, (-15.5, 7.25), occupancy)


def _odometry(frame: str = "odom", child_frame: str = "base") -> cdr.Odometry:
    covariance = np.arange(36.0).reshape(6, 6)
    return cdr.Odometry(-1, frame, child_frame, SE2(1.5, -2.5, 2.0), 13.9, -0.25, covariance, covariance + 0.5)


def _diagnostics(frame: str = "") -> cdr.DiagnosticArray:
    service = cdr.DiagnosticStatus(cdr.Level.WARN, "echogrid: service", "", "car", {})
    radar = cdr.DiagnosticStatus(cdr.Level.STALE, "echogrid: radar fl", "silent", "fl", {"late": "3", "": "", "ratio": "0.5"})
    return cdr.DiagnosticArray(1_700_000_000_123_456_789, frame, (service, radar))


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (3, 4), (4, 3), (128, 257)])
def test_grid_is_what_rosbags_writes(frame: str, shape: tuple[int, int]) -> None:
    grid = _grid(frame, *shape)
    assert cdr.encode_grid(grid) == bytes(STORE.serialize_cdr(_ros_grid(grid), "nav_msgs/msg/OccupancyGrid"))


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("child_frame", FRAMES)
def test_odometry_is_what_rosbags_writes(frame: str, child_frame: str) -> None:
    odometry = _odometry(frame, child_frame)
    assert cdr.encode_odometry(odometry) == bytes(STORE.serialize_cdr(_ros_odometry(odometry), "nav_msgs/msg/Odometry"))


@given(UPDATES)
def test_update_is_what_rosbags_writes_and_comes_back(update: cdr.GridUpdate) -> None:
    payload = cdr.encode_update(update)
    assert payload == bytes(STORE.serialize_cdr(_ros_update(update), "map_msgs/msg/OccupancyGridUpdate"))
    back = cdr.decode_update(payload)
    assert (back.stamp_ns, back.frame, back.x, back.y) == (update.stamp_ns, update.frame, update.x, update.y)
    np.testing.assert_array_equal(back.occupancy, update.occupancy)


@given(TRANSFORMS)
def test_transforms_are_what_rosbags_writes_and_come_back(transforms: list[cdr.Transform]) -> None:
    payload = cdr.encode_transforms(transforms)
    assert payload == bytes(STORE.serialize_cdr(_ros_transforms(transforms), "tf2_msgs/msg/TFMessage"))
    back = cdr.decode_transforms(payload)
    for one, other in zip(back, transforms, strict=True):
        assert (one.stamp_ns, one.frame, one.child_frame) == (other.stamp_ns, other.frame, other.child_frame)
        assert (one.pose.x, one.pose.y) == (other.pose.x, other.pose.y)
        assert math.cos(one.pose.yaw - other.pose.yaw) == pytest.approx(1, abs=1e-12)


@given(POINTS)
def test_points_are_what_rosbags_writes_and_come_back(points: cdr.Points) -> None:
    payload = cdr.encode_points(points)
    assert payload == bytes(STORE.serialize_cdr(_ros_points(points), "sensor_msgs/msg/PointCloud2"))
    back = cdr.decode_points(payload)
    assert (back.stamp_ns, back.frame) == (points.stamp_ns, points.frame)
    np.testing.assert_array_equal(back.points, points.points)


@given(DIAGNOSTICS)
def test_diagnostics_are_what_rosbags_writes_and_come_back(array: cdr.DiagnosticArray) -> None:
    payload = cdr.encode_diagnostics(array)
    assert payload == bytes(STORE.serialize_cdr(_ros_diagnostics(array), "diagnostic_msgs/msg/DiagnosticArray"))
    assert cdr.decode_diagnostics(payload) == array


def test_data_begins_at_the_smallest_x_and_y_and_runs_along_x() -> None:
    """Where ROS puts a cell: data[row * width + column] at origin + (column, row) * resolution."""
    occupancy = np.full((3, 5), -1, dtype=np.int8)
    occupancy[2, 1] = 88
    message = STORE.deserialize_cdr(cdr.encode_grid(cdr.Grid(0, "odom", 0.5, (-1.0, 4.0), occupancy)), "nav_msgs/msg/OccupancyGrid")
    index = int(np.argmax(message.data))
    assert (message.info.width, message.info.height) == (5, 3)
    x = message.info.origin.position.x + index % message.info.width * message.info.resolution
    y = message.info.origin.position.y + index // message.info.width * message.info.resolution
    assert (x, y) == (-0.5, 5.0)


def test_a_slice_of_a_larger_array_is_written_in_its_own_order() -> None:
    whole = np.arange(100, dtype=np.int8).reshape(10, 10)
    for view in (whole[2:5, 3:9], whole[::2, ::3], whole.T):
        decoded = cdr.decode_grid(cdr.encode_grid(cdr.Grid(0, "odom", 1.0, (0.0, 0.0), view)))
        np.testing.assert_array_equal(decoded.occupancy, view)


@given(GRIDS)
def test_grid_round_trip(grid: cdr.Grid) -> None:
    back = cdr.decode_grid(cdr.encode_grid(grid))
    assert (back.stamp_ns, back.frame, back.cell, back.origin) == (grid.stamp_ns, grid.frame, grid.cell, grid.origin)
    assert back.occupancy.dtype == np.int8
    assert back.occupancy.shape == grid.occupancy.shape
    np.testing.assert_array_equal(back.occupancy, grid.occupancy)


@given(ODOMETRIES)
def test_odometry_round_trip(odometry: cdr.Odometry) -> None:
    back = cdr.decode_odometry(cdr.encode_odometry(odometry))
    assert (back.stamp_ns, back.frame, back.child_frame) == (odometry.stamp_ns, odometry.frame, odometry.child_frame)
    assert (back.pose.x, back.pose.y) == (odometry.pose.x, odometry.pose.y)
    assert math.cos(back.pose.yaw - odometry.pose.yaw) == pytest.approx(1, abs=1e-12)
    assert -math.pi <= back.pose.yaw <= math.pi
    assert (back.speed, back.yaw_rate) == (odometry.speed, odometry.yaw_rate)
    np.testing.assert_array_equal(back.pose_covariance, odometry.pose_covariance)
    np.testing.assert_array_equal(back.twist_covariance, odometry.twist_covariance)


@given(st.integers(-(2**63), 2**63 - 1), STAMPS, st.binary(min_size=16, max_size=16))
def test_attachment_round_trip(sequence: int, stamp_ns: int, gid: bytes) -> None:
    attachment = cdr.encode_attachment(sequence, stamp_ns, gid)
    assert len(attachment) == 33
    assert cdr.decode_attachment(attachment) == (sequence, stamp_ns, gid)


@given(st.integers(1, 2**63 - 1), STAMPS, st.binary(min_size=16, max_size=16), st.integers(0, 2**32 - 1), st.integers(0, 2**63 - 1))
def test_attachment_of_a_grid_round_trip(sequence: int, stamp_ns: int, gid: bytes, epoch: int, keyframe: int) -> None:
    attachment = cdr.encode_attachment(sequence, stamp_ns, gid) + cdr.encode_version(epoch, keyframe)
    assert len(attachment) == 45
    assert cdr.decode_grid_attachment(attachment) == (sequence, stamp_ns, gid, epoch, keyframe)


def test_attachment_bytes() -> None:
    assert cdr.encode_version(2, 258).hex() == "02000000" + "0201000000000000"
    expected = "010000000000000000ca9a3b0000000010" + bytes(range(16)).hex()
    assert cdr.encode_attachment(1, 10**9, bytes(range(16))).hex() == expected


def test_probability() -> None:
    grid = cdr.Grid(0, "odom", 1.0, (0.0, 0.0), np.array([[-1, 0], [50, 100]], dtype=np.int8))
    assert grid.probability.dtype == np.float32
    np.testing.assert_array_equal(grid.probability, np.array([[np.nan, 0], [0.5, 1]], dtype=np.float32))


TRANSFORM = cdr.Transform(1_700_000_000_123_456_789, "odom", "base", SE2(1.5, -2.5, 2.0))
POINTS_OF_TWO = cdr.Points(7, "base", np.arange(6, dtype=np.float32).reshape(2, 3))
DECODERS = (
    pytest.param(cdr.encode_update(cdr.GridUpdate(5, "odom", 3, 4, _grid().occupancy)), cdr.decode_update, id="update"),
    pytest.param(cdr.encode_transforms((TRANSFORM, TRANSFORM)), cdr.decode_transforms, id="transforms"),
    pytest.param(cdr.encode_points(POINTS_OF_TWO), cdr.decode_points, id="points"),
    pytest.param(cdr.encode_grid(_grid()), cdr.decode_grid, id="grid"),
    pytest.param(cdr.encode_odometry(_odometry()), cdr.decode_odometry, id="odometry"),
    pytest.param(cdr.encode_diagnostics(_diagnostics()), cdr.decode_diagnostics, id="diagnostics"),
    pytest.param(cdr.encode_attachment(1, 2, bytes(16)), cdr.decode_attachment, id="attachment"),
    pytest.param(cdr.encode_attachment(1, 2, bytes(16)) + cdr.encode_version(3, 4), cdr.decode_grid_attachment, id="attachment of a grid"),
)


@pytest.mark.parametrize(("good", "decode"), DECODERS)
def test_every_other_length_is_refused(good: bytes, decode) -> None:
    decode(good)
    for length in range(len(good)):
        with pytest.raises(ValueError, match=r"\w+ \w+"):
            decode(good[:length])
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        decode(good + b"\0")


@pytest.mark.parametrize(("good", "decode"), DECODERS)
def test_hostile_bytes_are_refused_with_value_error(good: bytes, decode) -> None:
    @given(st.binary(max_size=200), st.lists(st.tuples(st.integers(0, len(good) - 1), st.integers(0, 255)), max_size=8))
    def check(noise: bytes, changes: list[tuple[int, int]]) -> None:
        changed = bytearray(good)
        for index, value in changes:
            changed[index] = value
        for payload in (noise, cdr.LITTLE_ENDIAN + noise, bytes(changed)):
            try:
                decode(payload)
            except ValueError as error:
                assert type(error) is ValueError  # noqa: PT017  not a UnicodeDecodeError or the like
                assert str(error)  # noqa: PT017

    check()


def _patched(payload: bytes, at: int, layout: str, *values: float) -> bytes:
    """The payload with other values at an offset counted behind the encapsulation header."""
    changed = bytearray(payload)
    struct.pack_into(layout, changed, 4 + at, *values)
    return bytes(changed)


# For the frame "odom": stamp 0, length 8, frame 12, map_load_time 20, resolution 28, width 32, height 36, position 40,
# orientation 64, count 96, data 100.
@pytest.mark.parametrize(
    ("at", "layout", "values", "message"),
    [
        (4, "<I", (10**9,), "ns beside"),
        (8, "<I", (0,), "name of 0 bytes"),
        (8, "<I", (2**32 - 1,), "name of 4294967295 bytes"),
        (13, "<B", (0,), "only NUL"),
        (13, "<B", (0xFF,), "no UTF-8"),
        (28, "<f", (math.nan,), "nowhere"),
        (28, "<f", (0,), "nowhere"),
        (40, "<d", (math.inf,), "nowhere"),
        (48, "<d", (math.nan,), "nowhere"),
        (56, "<d", (1,), "lifted or turned"),
        (88, "<d", (math.nan,), "lifted or turned"),
        (32, "<II", (2**32 - 1, 2**32 - 1), "says it has 12"),
        (32, "<II", (3, 3), "says it has 12"),
        (96, "<I", (2**32 - 1,), "says it has 4294967295 and brings 12"),
        (100, "<b", (-2,), "outside"),
        (100, "<b", (101,), "outside"),
    ],
)
def test_a_grid_that_cannot_be_is_refused(at: int, layout: str, values: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cdr.decode_grid(_patched(cdr.encode_grid(_grid()), at, layout, *values))


def test_a_grid_of_no_rows_and_billions_of_columns_costs_nothing() -> None:
    payload = _patched(_patched(cdr.encode_grid(_grid())[: 4 + 100], 32, "<II", 2**32 - 1, 0), 96, "<I", 0)
    assert cdr.decode_grid(payload).occupancy.size == 0


# For the frame "odom": x 20, y 24, width 28, height 32, count 36, data 40.
@pytest.mark.parametrize(
    ("at", "layout", "values", "message"),
    [
        (20, "<i", (-1,), "outside its grid"),
        (24, "<i", (-(2**31),), "outside its grid"),
        (28, "<II", (2**32 - 1, 2**32 - 1), "says it has 12"),
        (28, "<II", (3, 3), "says it has 12"),
        (36, "<I", (2**32 - 1,), "says it has 4294967295 and brings 12"),
        (40, "<b", (-2,), "outside -1"),
        (40, "<b", (101,), "outside -1"),
    ],
)
def test_an_update_that_cannot_be_is_refused(at: int, layout: str, values: tuple[float, ...], message: str) -> None:
    payload = cdr.encode_update(cdr.GridUpdate(5, "odom", 3, 4, _grid().occupancy))
    with pytest.raises(ValueError, match=message):
        cdr.decode_update(_patched(payload, at, layout, *values))


# For the frames "odom" and "base": count 0, stamp 4, frame's length 12, child's length 24, translation 40, rotation 64.
@pytest.mark.parametrize(
    ("at", "layout", "values", "message"),
    [
        (0, "<I", (0,), "are left over"),
        (0, "<I", (2**32 - 1,), "message ends"),
        (40, "<d", (math.nan,), "nowhere"),
        (48, "<d", (math.inf,), "nowhere"),
        (56, "<d", (1.0,), "leaves the plane"),
        (64, "<d", (0.5,), "no turn"),
        (80, "<dd", (0.0, 0.0), "no turn"),
        (88, "<d", (math.nan,), "no turn"),
    ],
)
def test_transforms_that_cannot_be_are_refused(at: int, layout: str, values: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cdr.decode_transforms(_patched(cdr.encode_transforms((TRANSFORM,)), at, layout, *values))


# For the frame "base": height 20, width 24, fields 28, 32 ("x": length, name, offset 40, datatype 44, count 48) ..., 92 is_bigendian,
# point_step 96, row_step 100, size 104, data 108, is_dense 132.
@pytest.mark.parametrize(
    ("at", "layout", "values", "message"),
    [
        (20, "<I", (2,), "not laid out"),
        (24, "<I", (3,), "3 points say"),
        (24, "<I", (2**32 - 1,), "4294967295 points say"),
        (28, "<I", (2,), "not laid out"),
        (28, "<I", (2**32 - 1,), "message ends|name of|not laid out"),
        (40, "<I", (4,), "not laid out"),
        (44, "<B", (8,), "not laid out"),
        (48, "<I", (2,), "not laid out"),
        (92, "<B", (1,), "not laid out"),
        (96, "<I", (16,), "not laid out"),
        (100, "<I", (12,), "bytes and bring"),
        (104, "<I", (2**32 - 1,), "bytes and bring"),
        (108, "<f", (math.nan,), "no number"),
        (132, "<B", (0,), "bytes and bring"),
    ],
)
def test_points_that_cannot_be_are_refused(at: int, layout: str, values: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cdr.decode_points(_patched(cdr.encode_points(POINTS_OF_TWO), at, layout, *values))


# For the frames "odom" and "base": child's length 20, child 24, padding, position 32, orientation 56, covariance 88.
@pytest.mark.parametrize(
    ("at", "values", "message"),
    [(32, (math.nan,), "no number"), (88, (math.inf,), "no number"), (56, (0.5,), "no turn"), (72, (0.0, 0.0), "no turn")],
)
def test_odometry_that_cannot_be_is_refused(at: int, values: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cdr.decode_odometry(_patched(cdr.encode_odometry(_odometry()), at, f"<{len(values)}d", *values))


# For the frame "": length 8, number of parts 16, level 20, name's length 24, name 28, message's length 48, hardware_id's 56, pairs 64.
@pytest.mark.parametrize(
    ("at", "layout", "value", "message"),
    [
        (16, "<I", 1, "are left over"),
        (16, "<I", 2**32 - 1, "message ends"),
        (20, "<B", 4, "level of 4"),
        (24, "<I", 2**32 - 1, "name of 4294967295 bytes"),
        (64, "<I", 2**32 - 1, "name of|message ends"),
    ],
)
def test_diagnostics_that_cannot_be_are_refused(at: int, layout: str, value: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        cdr.decode_diagnostics(_patched(cdr.encode_diagnostics(_diagnostics()), at, layout, value))


def test_of_a_key_that_comes_twice_the_last_counts() -> None:
    """Other programs may write such."""
    pair = ROS["diagnostic_msgs/msg/KeyValue"]
    array = _ros_diagnostics(_diagnostics())
    array.status[0].values.extend((pair(key="a", value="1"), pair(key="a", value="2")))
    assert cdr.decode_diagnostics(bytes(STORE.serialize_cdr(array, "diagnostic_msgs/msg/DiagnosticArray"))).status[0].values == {"a": "2"}


def test_big_endian_is_refused() -> None:
    with pytest.raises(ValueError, match="00 00 00 00"):
        cdr.decode_grid(b"\0\0\0\0" + bytes(200))


def test_what_does_not_fit_into_a_message_is_refused() -> None:
    occupancy = np.zeros((1, 1), dtype=np.int8)
    with pytest.raises(ValueError, match="32-bit seconds"):
        cdr.encode_grid(cdr.Grid(2**31 * cdr.SECOND, "odom", 1.0, (0.0, 0.0), occupancy))
    with pytest.raises(ValueError, match="NUL"):
        cdr.encode_grid(cdr.Grid(0, "od\0m", 1.0, (0.0, 0.0), occupancy))
    with pytest.raises(ValueError, match="gid of 3 bytes"):
        cdr.encode_attachment(1, 0, b"abc")


def test_the_bytes_in_the_document_are_ours() -> None:
    """Whoever writes a client by them reads what we send."""
    document = (DOCS / "interface.md").read_text()
    lines = re.findall(r"^    ([0-9a-f]{4})  ((?:[0-9a-f]{2} {1,2})*[0-9a-f]{2})(?: {2,}|$)", document, re.MULTILINE)
    second = next(n for n, (at, _) in enumerate(lines) if n and at == "0000")
    update, attachment = (bytes.fromhex("".join(data for _, data in part)) for part in (lines[:second], lines[second:]))
    stamp_ns, gid = 1_700_000_000_123_456_789, bytes(range(0xA0, 0xB0))
    assert update == cdr.encode_update(cdr.GridUpdate(stamp_ns, "odom", 3, 4, np.array([[97, -1, 50]], np.int8)))
    assert attachment == cdr.encode_attachment(7, stamp_ns, gid) + cdr.encode_version(2, 41)
    assert [int(at, 16) for at, _ in lines[:second]] == [0, 4, 12, 21, 24, 32, 40]
