"""A simulated street with its lidar's turns, for tests to write down as a data set's official layout has it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from tests.support import tiny_towns
from tests.support.agreement import agreement

from echogrid.core.evidence.raster import GridSpec
from echogrid.core.motion.se2 import SE2
from echogrid_training.drives.lidar_writer import turns
from echogrid_training.drives.simulate import from_first_pose, lidar_turns, truth_map
from echogrid_training.recording import EPOCH_NS
from echogrid_training.sensors import lidar
from echogrid_training.towns.town import Town
from echogrid_training.truth.ground_truth import TruthMap
from echogrid_training.truth.simulated_truth import SimulatedTruth

SPEC = GridSpec()


@dataclass(frozen=True)
class Street:
    """Points of each turn are in base: x ahead and y left of the rear axle, z above the ground."""

    town: Town
    stamp_ns: list[int]
    points: list[np.ndarray]
    poses: list[SE2]
    truth: TruthMap

    def with_lidar_at(self, x: float) -> Street:
        """The same turns of a car whose rear axle is elsewhere, so that its lidar is `x` m ahead of it."""
        shift = lidar.BASE_FROM_LIDAR.x - x
        points = [one - (shift, 0.0, 0.0) for one in self.points]
        return replace(self, points=points, poses=[pose @ SE2(shift, 0.0, 0.0) for pose in self.poses])

    def agreement(self, found: SimulatedTruth) -> tuple[float, float]:
        """IoU of occupied within a cell, and of free where both know, in the patches around the car."""
        places = [(there, found.pose(stamp)) for stamp, there in zip(self.stamp_ns[2:-2:4], self.poses[2:-2:4], strict=True)]
        assert all(here is not None for _, here in places)
        return agreement((self.truth.patch(there, SPEC), found.map.patch(here, SPEC)) for there, here in places)


@pytest.fixture(scope="session")
def street() -> Street:
    """Two seconds and a half through a bend between houses and parked cars, nothing else moving."""
    things = tiny_towns.street(3.0).things
    town = tiny_towns.town(*things, ego=tiny_towns.track(2.5, 6.0, yaw_rate=0.05, y=-1.6))
    found = list(turns(town))
    place = np.array((lidar.BASE_FROM_LIDAR.x, 0.0, lidar.HEIGHT))
    time = np.array([stamp - EPOCH_NS for stamp, _ in found]) * 1e-9
    poses = [SE2(6.0 / 0.05 * np.sin(0.05 * t), 6.0 / 0.05 * (1 - np.cos(0.05 * t)), 0.05 * t) for t in time.tolist()]
    return Street(
        town,
        [stamp for stamp, _ in found],
        [points + place for _, points in found],
        poses,
        truth_map(list(lidar_turns(from_first_pose(town)))),
    )
