"""Where the lidar is on the car: a file of its own beside the configuration, since the service has no lidar."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from echogrid.config.toml import Table, load
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2

Angle = Annotated[float, Meta(ge=-360, le=360)]
Metres = Annotated[float, Meta(ge=-20, le=20)]


class OdometryMount(Table, frozen=True):
    """[odometry]: where the child frame of the odometry topic is in base."""

    x: Metres = 0.0
    y: Metres = 0.0
    yaw_deg: Angle = 0.0
    latency_ms: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0  # taken off the stamps

    def base_from_child(self) -> SE2:
        return SE2(self.x, self.y, math.radians(self.yaw_deg))


class LidarMount(Table, frozen=True):
    """lidar.toml: place in base (x forward and y left of the rear axle's centre, z above the ground), and yaw after pitch after roll."""

    x: Metres
    y: Metres
    z: Annotated[float, Meta(ge=0.1, le=20)]
    yaw_deg: Angle = 0.0
    pitch_deg: Angle = 0.0  # positive: nose down
    roll_deg: Angle = 0.0
    latency_ms: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0  # taken off the stamps, which should be of the middle of a turn
    odometry: OdometryMount = OdometryMount()


@dataclass(frozen=True, slots=True, eq=False)
class Pose3:
    """base_from_lidar."""

    rotation: Floats  # (3, 3)
    place: Floats  # (3,) m

    def apply(self, points: Floats) -> Floats:
        """(N, 3) m."""
        moved: Floats = points @ self.rotation.T + self.place
        return moved


def load_mount(path: Path) -> LidarMount:
    """Raises EchogridError."""
    return load(path, LidarMount)


def base_from_lidar(mount: LidarMount) -> Pose3:
    """As the file says."""
    yaw, pitch, roll = (math.radians(value) for value in (mount.yaw_deg, mount.pitch_deg, mount.roll_deg))
    z = np.array(((math.cos(yaw), -math.sin(yaw), 0), (math.sin(yaw), math.cos(yaw), 0), (0, 0, 1)))
    y = np.array(((math.cos(pitch), 0, math.sin(pitch)), (0, 1, 0), (-math.sin(pitch), 0, math.cos(pitch))))
    x = np.array(((1, 0, 0), (0, math.cos(roll), -math.sin(roll)), (0, math.sin(roll), math.cos(roll))))
    return Pose3(z @ y @ x, np.array((mount.x, mount.y, mount.z)))
