"""A street that rises and falls: one height cuts it where the ground leaves the plane of the wheels, following the ground does not."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.support import tiny_towns
from tests.training.labelling.test_label import agreement

from echogrid.core.motion.se2 import SE2
from echogrid_training import cli
from echogrid_training.drives.simulate import LidarView
from echogrid_training.labelling.bring import read_turns, write_turns
from echogrid_training.labelling.clouds import Cloud
from echogrid_training.labelling.ground import flat, followed
from echogrid_training.sensors import lidar
from echogrid_training.truth.simulated_truth import load_simulated_truth

HIGH, LONG = 1.2, 60.0  # m: hills of that height and length, so that the steepest is 12.6 %
LIDAR = np.array((lidar.BASE_FROM_LIDAR.x, 0.0, lidar.HEIGHT))


def hills(x: np.ndarray) -> np.ndarray:
    return HIGH * (1 - np.cos(2 * np.pi * x / LONG))


def lifted(points: np.ndarray, pose: SE2) -> np.ndarray:
    """Points (N, 3) of a lidar on a level street, in its frame, as they are where that street lies on hills: the car tilts with it."""
    world = np.concatenate((pose.apply(points[:, :2] + LIDAR[:2]), points[:, 2:] + LIDAR[2]), axis=1)
    world[:, 2] += hills(world[:, 0])
    slope = HIGH * 2 * np.pi / LONG * np.sin(2 * np.pi * pose.x / LONG)
    up = np.array((-slope, 0.0, 1.0)) / np.hypot(slope, 1.0)
    heading = np.array((np.cos(pose.yaw), np.sin(pose.yaw), np.cos(pose.yaw) * slope))
    ahead = heading / np.linalg.norm(heading)
    axes = np.stack((ahead, np.cross(up, ahead), up), axis=1)  # world_from_base
    return (world - (pose.x, pose.y, hills(np.array(pose.x)))) @ axes - LIDAR


@pytest.mark.parametrize("x", [0.0, 15.0, 22.0, 30.0, 45.0])
def test_ground_is_ground_and_what_stands_stands(x: float) -> None:
    """In a street of houses, parked cars and kerbs, from several places on the hills."""
    town = tiny_towns.street(8.0)
    view = LidarView(tiny_towns.town(*town.things, ego=tiny_towns.track(1.0, x=x, y=-1.6)), np.array([0.0]))
    turn, _ = view.turn(0)
    back = np.isfinite(turn.distance) & (turn.distance < 40.0)
    bearing = np.broadcast_to(lidar.bearings()[:, None], back.shape)[back]
    true, distance = turn.height[back], turn.distance[back]
    level = np.stack((distance * np.cos(bearing), distance * np.sin(bearing), true - lidar.HEIGHT), axis=-1)
    points = lifted(level, SE2(x, -1.6, 0.0)) + LIDAR
    by_hills, by_plane = followed(points, LIDAR), flat(points, LIDAR)
    ground, stands = true < 0.05, (true > 0.6) & (true < 1.5)
    assert (by_hills[ground] > lidar.GROUND).mean() < 0.01
    assert ((by_hills[stands] > lidar.GROUND) & (by_hills[stands] < lidar.ROOF)).mean() > 0.97
    wrong = (by_plane[ground] > lidar.GROUND).mean() + (by_plane[stands] < lidar.GROUND).mean() + (by_plane[stands] > lidar.ROOF).mean()
    assert wrong > 0.08
    assert np.percentile(np.abs(followed(level + LIDAR, LIDAR)[ground]), 99) < 0.1


def test_a_street_on_hills_is_labelled_as_on_the_level(car: Path, labelled: Path, tmp_path: Path) -> None:
    true = load_simulated_truth(car / "truth.npz")
    folder = tmp_path / "hills"
    shutil.copytree(labelled, folder)
    turns = [(turn.cloud(), true.pose(turn.stamp_ns)) for turn in read_turns(labelled)]
    write_turns(folder / "lidar.npz", [Cloud(one.stamp_ns, lifted(one.points, pose)) for one, pose in turns if pose is not None])
    said = {}
    for ground in ("flat", "followed"):
        assert cli.main(["label", str(folder), "--ground", ground, "--force"]) == 0
        said[ground] = agreement(true, load_simulated_truth(folder / "truth.npz"))
        assert json.loads((folder / "label.json").read_text())["ground"] == ground
    assert said["followed"][0] >= 0.9
    assert said["followed"][1] >= 0.97
    assert said["flat"][0] < 0.6


def test_on_level_ground_both_say_the_same(car: Path, labelled: Path, tmp_path: Path) -> None:
    true = load_simulated_truth(car / "truth.npz")
    folder = tmp_path / "level"
    shutil.copytree(labelled, folder)
    assert cli.main(["label", str(folder), "--ground", "followed", "--force"]) == 0
    plain, other = (agreement(true, load_simulated_truth(one / "truth.npz")) for one in (labelled, folder))
    assert other[0] > plain[0] - 0.02
    assert other[1] > plain[1] - 0.005
