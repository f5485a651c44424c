"""The truth of a simulated drive: the lidar's turns are of the time they are asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support.tiny_drives import room_drive
from tests.support.tiny_towns import track

from echogrid.core.motion.se2 import SE2
from echogrid_training.recording import LidarTurns
from echogrid_training.sensors.lidar import AZIMUTHS
from echogrid_training.truth.ground_truth import TruthMap
from echogrid_training.truth.simulated_truth import SimulatedTruth, load_simulated_truth

MS = 1_000_000  # ns


@pytest.mark.parametrize(("now_ms", "turn"), [(0, 0), (99, 0), (100, 1), (199, 1), (250, 2), (-5, 0)])
def test_a_turn_is_never_of_the_future(now_ms: int, turn: int) -> None:
    """Unless there is none before."""
    ranges = np.array([[1.0], [2.0], [3.0]]) * np.ones(AZIMUTHS)
    turns = LidarTurns(np.array([0, 100, 200]) * MS, ranges)
    poses = np.array([(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)])
    truth = SimulatedTruth(np.array([0, 300]) * MS, poses, TruthMap(np.zeros((1, 1), np.float32), (0.0, 0.0), 0.25), turns)
    assert truth.lidar_at(now_ms * MS)[0] == turn + 1.0
    if now_ms >= 0:  # its returns lie where it saw them from: the lidar is 1.35 m ahead of base, which drives a metre a turn
        centre = truth.lidar_points(now_ms * MS, SE2(0.0, 0.0, 0.0)).mean(axis=0)
        np.testing.assert_allclose(centre, (1.35 + turn, 0.0), atol=1e-6)


def test_a_drive_keeps_every_turn_and_in_it_the_room(tmp_path: Path) -> None:
    """Its walls, 28 m and 14 m apart, as they stand around the first pose."""
    truth = load_simulated_truth(room_drive(tmp_path / "drive", track(1.0, speed=2.0)) / "truth.npz")
    np.testing.assert_array_equal(np.diff(truth.lidar.stamp_ns), 100 * MS)
    assert len(truth.lidar.stamp_ns) == 10
    points = truth.lidar_points(int(truth.lidar.stamp_ns[4]), SE2(0.0, 0.0, 0.0))
    np.testing.assert_allclose(np.ptp(points, axis=0), (28.0, 14.0), atol=0.2)
    low, high = points.min(axis=0), points.max(axis=0)
    walls = np.concatenate([np.column_stack((np.full(9, x), np.linspace(low[1] + 2, high[1] - 2, 9))) for x in (low[0], high[0])])
    near = [truth.map.at(walls + np.array((off, 0.0))) > 0 for off in (-0.25, 0.0, 0.25)]
    assert np.any(near, axis=0).mean() > 0.8  # the map has them where the turn has, so its origin is x and then y


def test_poses_are_on_the_line_between_their_neighbours_whenever_the_drive_began() -> None:
    poses = np.array([(0.0, 0.0, 0.0), (3.0, 6.0, 0.3)])
    turns = LidarTurns(np.array([1000]) * MS, np.ones((1, AZIMUTHS)))
    truth = SimulatedTruth(np.array([1000, 1300]) * MS, poses, TruthMap(np.zeros((1, 1), np.float32), (0.0, 0.0), 0.25), turns)
    pose = truth.pose(1100 * MS)
    assert pose is not None
    np.testing.assert_allclose((pose.x, pose.y, pose.yaw), (1.0, 2.0, 0.1))
    assert truth.pose(999 * MS) is None
    assert truth.pose(1301 * MS) is None
