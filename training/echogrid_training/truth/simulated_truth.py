"""The truth of a simulated drive as its folder holds it: poses, the true map, and the turns of the lidar."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid_training.recording import LidarTurns, Stamps
from echogrid_training.sensors.lidar import BASE_FROM_LIDAR, bearings
from echogrid_training.sources import load_npz
from echogrid_training.truth.ground_truth import TruthMap

KEYS = ("stamp_ns", "x", "y", "yaw", "log_odds", "origin", "cell", "lidar_stamp_ns", "lidar_cm")


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedTruth:
    """Everything in the frame of the drive's first pose."""

    stamp_ns: Stamps  # (N,)
    poses: Floats  # (N, 3) x, y (m) and yaw (rad) of base
    map: TruthMap
    lidar: LidarTurns

    def pose(self, stamp_ns: int) -> SE2 | None:
        """Of base at a time; None outside the drive."""
        if not self.stamp_ns[0] <= stamp_ns <= self.stamp_ns[-1]:
            return None
        seconds = (self.stamp_ns - self.stamp_ns[0]) * 1e-9
        return SE2(*(float(np.interp((stamp_ns - self.stamp_ns[0]) * 1e-9, seconds, column)) for column in self.poses.T))

    def lidar_at(self, stamp_ns: int) -> Floats:
        """(B,) m: the newest turn."""
        newest: Floats = self.lidar.ranges[self._turn(stamp_ns)]
        return newest

    def lidar_points(self, stamp_ns: int, truth_from_base: SE2) -> Floats:
        """(N, 2) m: the returns of the newest turn, in base at `truth_from_base`."""
        turn = self._turn(stamp_ns)
        ranges, there = self.lidar.ranges[turn], self.pose(int(self.lidar.stamp_ns[turn]))
        if there is None:
            return np.empty((0, 2))
        back = np.isfinite(ranges)
        lidar, ranges, bearing = there @ BASE_FROM_LIDAR, ranges[back], bearings()[back]
        points = np.stack((lidar.x + ranges * np.cos(bearing), lidar.y + ranges * np.sin(bearing)), axis=1)
        return truth_from_base.inverse().apply(points)

    def _turn(self, stamp_ns: int) -> int:
        """Of the turns that were over at this time the last, as a map update has the radars' last scans; before the first turn that one."""
        return max(int(np.searchsorted(self.lidar.stamp_ns, stamp_ns, side="right")) - 1, 0)


def load_simulated_truth(path: Path) -> SimulatedTruth:
    """Raises EchogridError for a file without a true map."""
    arrays = load_npz(path, KEYS)
    ranges = np.where(arrays["lidar_cm"] > 0, arrays["lidar_cm"] / 100.0, np.inf)
    return SimulatedTruth(
        arrays["stamp_ns"],
        np.stack([arrays[key] for key in ("x", "y", "yaw")], axis=1),
        TruthMap(arrays["log_odds"], (float(arrays["origin"][0]), float(arrays["origin"][1])), float(arrays["cell"])),
        LidarTurns(arrays["lidar_stamp_ns"], ranges),
    )
