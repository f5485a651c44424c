"""Poses out of an odometry topic: where base was, whatever frame they are in and wherever their child frame is on the car."""

from __future__ import annotations

import json
import math
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from tests.training.labelling.test_label import agreement

from echogrid.core.motion.se2 import SE2
from echogrid.recording.mcap_writer import McapWriter
from echogrid.topics.cdr import LITTLE_ENDIAN, encode_header, encode_text, padded
from echogrid.topics.poses import Odometry, encode_odometry
from echogrid.topics.topic import Message, Topic
from echogrid_training import cli
from echogrid_training.labelling.odometry import Poses, decode_pose, load_poses
from echogrid_training.truth.simulated_truth import SimulatedTruth, load_simulated_truth

TOPIC = Topic("/odom", "nav_msgs/msg/Odometry", "/odom")
MAP_FROM_START = SE2(412.0, -77.0, 2.5)
BASE_FROM_CHILD = SE2(1.4, 0.2, math.radians(90.0))  # a sensor ahead of the axle that looks to the left
MOUNT = "\n[odometry]\nx = 1.4\ny = 0.2\nyaw_deg = 90\n"


def write_bag(path: Path, poses: list[tuple[int, SE2]], topic: Topic = TOPIC) -> Path:
    with McapWriter(path) as writer:
        for stamp_ns, pose in poses:
            writer.put(Message(topic, encode_odometry(Odometry(stamp_ns, "map", "sensor", pose, 0.0, 0.0)), stamp_ns, 0, 0))
    return path


def sensed(truth: SimulatedTruth) -> list[tuple[int, SE2]]:
    """True poses every 50 ms as a sensor on the car would have them."""
    stamps = range(int(truth.stamp_ns[0]), int(truth.stamp_ns[-1]), 50_000_000)
    return [(stamp, MAP_FROM_START @ pose @ BASE_FROM_CHILD) for stamp in stamps if (pose := truth.pose(stamp)) is not None]


def bring(car: Path, bag: Path, mount: Path, out: Path, *more: str) -> int:
    arguments = [str(car / "can.log.gz"), "-c", str(car / "echogrid.toml"), "--lidar", str(car / "lidar.mcap"), "--mount", str(mount)]
    return cli.main(["import", "own", *arguments, "--odometry", str(bag), *more, "--out", str(out)])


def test_label_goes_by_the_poses_of_a_topic(car: Path, tmp_path: Path) -> None:
    true = load_simulated_truth(car / "truth.npz")
    mount = tmp_path / "lidar.toml"
    mount.write_text((car / "lidar.toml").read_text() + MOUNT)
    out = tmp_path / "posed"
    assert bring(car, write_bag(tmp_path / "odom.mcap", sensed(true)), mount, out) == 0
    poses = load_poses(out / "poses.npz")
    assert poses is not None
    for index in range(0, len(poses.stamp_ns), 20):
        there = true.pose(int(poses.stamp_ns[index]))
        assert there is not None
        wanted = there  # in the frame of the first pose, as the simulator has it
        assert (poses.x[index], poses.y[index]) == pytest.approx((wanted.x, wanted.y), abs=1e-6)
        assert math.cos(poses.yaw[index] - wanted.yaw) == pytest.approx(1.0, abs=1e-9)
    assert cli.main(["label", str(out)]) == 0
    assert json.loads((out / "label.json").read_text())["poses"] == "odometry"
    found = load_simulated_truth(out / "truth.npz")
    off = [(found.pose(stamp), true.pose(stamp)) for stamp in found.stamp_ns[::10].tolist()]
    assert max(math.hypot(a.x - b.x, a.y - b.y) for a, b in off if a and b) < 0.05
    occupied, free = agreement(true, found)
    assert occupied >= 0.9
    assert free >= 0.97


def test_a_drive_without_motion_on_its_bus_can_be_labelled_by_poses(car: Path, labelled: Path, tmp_path: Path) -> None:
    """What the bus says of ego motion is needed for nothing but movers then."""
    true = load_simulated_truth(car / "truth.npz")
    folder = tmp_path / "drive"
    shutil.copytree(labelled, folder)
    for name in ("truth.npz", "label.json"):
        (folder / name).unlink()
    text = (folder / "echogrid.toml").read_text()
    silent = '[[bus]]\nname = "silent"\nchannel = "can9"\n\n[motion]\nbus = "silent"'
    (folder / "echogrid.toml").write_text(text.replace('[motion]\nbus = "can0"', silent))
    assert cli.main(["label", str(folder)]) == 1
    stamps = np.arange(int(true.stamp_ns[0]), int(true.stamp_ns[-1]), 50_000_000)
    there = [pose for stamp in stamps if (pose := true.pose(int(stamp))) is not None]
    x, y, yaw = np.array([(one.x, one.y, one.yaw) for one in there]).T
    np.savez(folder / "poses.npz", stamp_ns=stamps, x=x, y=y, yaw=yaw)
    assert cli.main(["label", str(folder)]) == 0


def test_poses_between_poses() -> None:
    """A circle of 10 m at 5 m/s: speed, yaw rate and place between samples, none beyond the ends and in gaps."""
    time = np.concatenate((np.arange(0.0, 4.0, 0.1), np.arange(6.0, 8.0, 0.1)))
    angle = 0.5 * time
    poses = Poses(np.round(time * 1e9).astype(np.int64), 10 * np.sin(angle), 10 * (1 - np.cos(angle)), angle)
    between, on, early, gap = poses.at(np.array([1_050_000_000, 2_000_000_000, -1, 5_000_000_000]))
    assert early is None
    assert gap is None
    for state, t in ((between, 1.05), (on, 2.0)):
        assert state is not None
        assert (state.speed, state.yaw_rate) == pytest.approx((5.0, 0.5), rel=2e-3)
        assert (state.odom_from_base.x, state.odom_from_base.y) == pytest.approx(
            (10 * math.sin(t / 2), 10 * (1 - math.cos(t / 2))), abs=5e-3
        )


def test_heading_of_a_car_that_pitches() -> None:
    """Yaw 0.7 after pitch 0.2: its x axis seen from above."""
    yaw, pitch = 0.35, 0.1
    qx, qy, qz, qw = (
        -math.sin(yaw) * math.sin(pitch),
        math.cos(yaw) * math.sin(pitch),
        math.sin(yaw) * math.cos(pitch),
        math.cos(yaw) * math.cos(pitch),
    )
    head = padded(encode_header(7_000_000_001, "odom") + encode_text("base_link"), 8)
    stamp_ns, pose = decode_pose(b"".join((LITTLE_ENDIAN, head, struct.pack("<85d", 1, 2, 3, qx, qy, qz, qw, *[0.0] * 78))))
    assert stamp_ns == 7_000_000_001
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((1, 2, 0.7))


def test_whatever_is_missing_is_one_sentence(car: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    true = load_simulated_truth(car / "truth.npz")
    right = sensed(true)
    jumped = [(stamp, SE2(pose.x + 30.0 * (index > 40), pose.y, pose.yaw)) for index, (stamp, pose) in enumerate(right)]
    late = [(stamp + 10**11, pose) for stamp, pose in right]
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.db3").touch()
    two = tmp_path / "two.mcap"
    other = Topic("/wheel", TOPIC.type, "/wheel")
    with McapWriter(two) as writer:
        for topic in (TOPIC, other):
            writer.put(Message(topic, encode_odometry(Odometry(right[0][0], "odom", "base", SE2(0, 0, 0), 0.0, 0.0)), right[0][0], 0, 0))
    mount = car / "lidar.toml"
    wrong = tmp_path / "lidar.toml"
    wrong.write_text(mount.read_text() + "\n[odometry]\nyaw = 3\n")
    for bag, place, more, expected in (
        (tmp_path / "none.mcap", mount, (), "none.mcap: there is no such file or folder with an odometry topic"),
        (car / "can.log.gz", mount, (), "can.log.gz: expected an .mcap file or a bag of ROS 2 with nav_msgs/msg/Odometry"),
        (tmp_path / "bag", mount, (), "bag: is a bag in SQLite"),
        (
            car / "lidar.mcap",
            mount,
            (),
            "lidar.mcap: has 0 topics of type nav_msgs/msg/Odometry: expected one; its topics are /lidar/points",
        ),
        (two, mount, (), "two.mcap: has 2 topics of type nav_msgs/msg/Odometry: give one with --odometry-topic"),
        (two, mount, ("--odometry-topic", "/gps"), "two.mcap: has no topic /gps of type nav_msgs/msg/Odometry, found /odom, /wheel"),
        (two, mount, ("--odometry-topic", "/odom"), "two.mcap: holds 1 poses of nav_msgs/msg/Odometry, expected many"),
        (write_bag(tmp_path / "jumped.mcap", jumped), mount, (), "jumped.mcap: its odometry jumps by 29."),
        (write_bag(tmp_path / "late.mcap", late), mount, (), "late.mcap: its poses and the turns of"),
        (two, wrong, (), "lidar.toml: odometry: unknown key 'yaw'"),
    ):
        assert bring(car, bag, place, tmp_path / "out", *more) == 1
        printed = capsys.readouterr()
        assert expected in printed.err
        assert printed.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
