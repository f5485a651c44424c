"""Messages of every kind, as the service sends them."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from echogrid.core.motion.odometry import EgoState
from echogrid.topics.announcer import occupancy_percent
from echogrid.topics.diagnostic_array import DiagnosticArray, encode_diagnostics
from echogrid.topics.grids import Grid, GridUpdate, encode_grid, encode_update
from echogrid.topics.poses import Odometry, encode_odometry
from echogrid.topics.topic import DIAGNOSTICS, FULL, ODOMETRY, STATUS, UPDATE, Message, Topic


def grid(
    stamp_ns: int, row: int, column: int, cell: float, log_odds: np.ndarray, *, topic: Topic = FULL, epoch: int = 0, keyframe: int = 0
) -> Message:
    """A window of the map from a cell's row (y) and column (x) on."""
    told = Grid(stamp_ns, "odom", cell, (column * cell, row * cell), occupancy_percent(log_odds))
    return Message(topic, encode_grid(told), stamp_ns, epoch, keyframe)


def odometry(ego: EgoState) -> Message:
    told = Odometry(ego.stamp_ns, "odom", "base", ego.odom_from_base, ego.speed, ego.yaw_rate)
    return Message(ODOMETRY, encode_odometry(told), ego.stamp_ns, 0, 0)


def status(told: Mapping[str, object]) -> Message:
    return Message(STATUS, msgspec.json.encode(told), 0, 0, 0)


def diagnostics(told: DiagnosticArray) -> Message:
    return Message(DIAGNOSTICS, encode_diagnostics(told), told.stamp_ns, 0, 0)


def update(keyframe: int, stamp_ns: int, occupancy: np.ndarray, x: int = 0, y: int = 0, *, epoch: int = 0) -> Message:
    """Cells (H, W) percent that differ from a key frame, the first at row y and column x."""
    return Message(UPDATE, encode_update(GridUpdate(stamp_ns, "odom", x, y, occupancy)), stamp_ns, epoch, keyframe)
