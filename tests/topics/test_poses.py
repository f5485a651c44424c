"""Odometry and transforms against rosbags, byte for byte, and against bytes that mean harm."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.cdr_messages import FRAMES, NAMES, NUMBERS, ROS, STAMPS, STORE, odometry_of, patched, ros_header, ros_pose

from echogrid.core.motion.se2 import SE2
from echogrid.topics.poses import Odometry, Transform, decode_odometry, encode_odometry, encode_transforms

COVARIANCES = st.lists(NUMBERS, min_size=36, max_size=36).map(lambda values: np.array(values).reshape(6, 6))
ODOMETRIES = st.builds(
    Odometry,
    stamp_ns=STAMPS,
    frame=NAMES,
    child_frame=NAMES,
    pose=st.builds(SE2, NUMBERS, NUMBERS, st.floats(-50, 50)),
    speed=NUMBERS,
    yaw_rate=NUMBERS,
    pose_covariance=COVARIANCES,
    twist_covariance=COVARIANCES,
)
TRANSFORMS = st.lists(st.builds(Transform, STAMPS, NAMES, NAMES, st.builds(SE2, NUMBERS, NUMBERS, st.floats(-50, 50))), max_size=4)


def _ros_odometry(odometry: Odometry) -> object:
    pose, half = odometry.pose, odometry.pose.yaw / 2
    vector = ROS["geometry_msgs/msg/Vector3"]
    twist = ROS["geometry_msgs/msg/Twist"](linear=vector(odometry.speed, 0.0, 0.0), angular=vector(0.0, 0.0, odometry.yaw_rate))
    return ROS["nav_msgs/msg/Odometry"](
        header=ros_header(odometry.stamp_ns, odometry.frame),
        child_frame_id=odometry.child_frame,
        pose=ROS["geometry_msgs/msg/PoseWithCovariance"](
            pose=ros_pose(pose.x, pose.y, math.sin(half), math.cos(half)), covariance=odometry.pose_covariance.ravel()
        ),
        twist=ROS["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=odometry.twist_covariance.ravel()),
    )


def _ros_transforms(transforms: Sequence[Transform]) -> object:
    vector, quaternion = ROS["geometry_msgs/msg/Vector3"], ROS["geometry_msgs/msg/Quaternion"]
    stamped = []
    for transform in transforms:
        pose, half = transform.pose, transform.pose.yaw / 2
        place = ROS["geometry_msgs/msg/Transform"](vector(pose.x, pose.y, 0.0), quaternion(0.0, 0.0, math.sin(half), math.cos(half)))
        header = ros_header(transform.stamp_ns, transform.frame)
        stamped.append(ROS["geometry_msgs/msg/TransformStamped"](header, transform.child_frame, place))
    return ROS["tf2_msgs/msg/TFMessage"](stamped)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("child_frame", FRAMES)
def test_odometry_is_what_rosbags_writes(frame: str, child_frame: str) -> None:
    odometry = odometry_of(frame, child_frame)
    assert encode_odometry(odometry) == bytes(STORE.serialize_cdr(_ros_odometry(odometry), "nav_msgs/msg/Odometry"))


@given(TRANSFORMS)
def test_transforms_are_what_rosbags_writes(transforms: list[Transform]) -> None:
    assert encode_transforms(transforms) == bytes(STORE.serialize_cdr(_ros_transforms(transforms), "tf2_msgs/msg/TFMessage"))


@given(ODOMETRIES)
def test_odometry_round_trip(odometry: Odometry) -> None:
    back = decode_odometry(encode_odometry(odometry))
    assert (back.stamp_ns, back.frame, back.child_frame) == (odometry.stamp_ns, odometry.frame, odometry.child_frame)
    assert (back.pose.x, back.pose.y) == (odometry.pose.x, odometry.pose.y)
    assert math.cos(back.pose.yaw - odometry.pose.yaw) == pytest.approx(1, abs=1e-12)
    assert -math.pi <= back.pose.yaw <= math.pi
    assert (back.speed, back.yaw_rate) == (odometry.speed, odometry.yaw_rate)
    np.testing.assert_array_equal(back.pose_covariance, odometry.pose_covariance)
    np.testing.assert_array_equal(back.twist_covariance, odometry.twist_covariance)


# For the frames "odom" and "base": child's length 20, child 24, padding, position 32, orientation 56, covariance 88.
@pytest.mark.parametrize(
    ("at", "values", "message"),
    [
        (32, (math.nan,), "not a number"),
        (88, (math.inf,), "not a number"),
        (56, (0.5,), "not a rotation"),
        (72, (0.0, 0.0), "not a rotation"),
    ],
)
def test_odometry_that_cannot_be_is_refused(at: int, values: tuple[float, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        decode_odometry(patched(encode_odometry(odometry_of()), at, f"<{len(values)}d", *values))
