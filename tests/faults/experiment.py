"""A drive with a fault beside the same drive without: what was noticed, how soon, and what it did to pose and map."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass

import msgspec
import numpy as np

from echogrid.config.loading import load_config
from echogrid.config.tables import Config
from echogrid.core.map.tiled_map import probability
from echogrid.core.motion.se2 import SE2
from echogrid.core.trust.watch import State
from echogrid.pipeline import Pipeline
from tests.faults.drive import DEMO, Frame
from tests.faults.faults import Fault
from tests.support.one_by_one import mapped

LOOK = 0.05  # s between two looks at the state
FRESH = ("ok", "degraded")  # states in which the map claims to be right
DIFFERENT = 0.2  # of p


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """At a time of the drive: the state, which map it is, and the newest pose with the time that it is of."""

    time: float  # s
    state: State
    epoch: int
    pose: SE2 | None
    pose_time: float  # s


@dataclass(frozen=True, slots=True)
class Outcome:
    """`notice` and `recover` in seconds, None where it never happened; errors against the undisturbed drive."""

    state: str
    reason: str
    notice: float | None
    recover: float | None
    new_maps: int
    pose_error: float  # m, the largest while the map claimed to be fresh
    map_error: float  # share of the cells that both know whose p differs by more than DIFFERENT, at the drive's end


def config(cells: int) -> Config:
    """The demo's, with the analytic model on a patch of so many cells of the same 30 m."""
    loaded = load_config(DEMO / "echogrid.toml", "analytic")
    return msgspec.structs.replace(loaded, grid=msgspec.structs.replace(loaded.grid, cells=cells, cell=30.0 / cells))


class Ride:
    """A drive through the whole chain, looked at every LOOK s, whatever the frames' stamps say. It can be copied under way."""

    def __init__(self, cells: int) -> None:
        self.pipeline = Pipeline(config(cells), DEMO / "echogrid.toml")
        self.looks: list[Look] = []
        self.poses: list[tuple[float, SE2]] = []  # and their times
        self._heard = 0.0  # s, when the newest frame came

    def copy(self) -> Ride:
        """What it becomes from here on is its own; what never changes is shared."""
        readers = self.pipeline.signals.readers.values()
        keys = ("layout", "profile", "wheels", "yaw_rate", "direction")
        fixed = [getattr(reader, key) for reader in readers for key in keys if hasattr(reader, key)]
        return deepcopy(self, {id(one): one for one in (self.pipeline.config, self.pipeline.mapper.mounts, *fixed)})

    def drive(self, frames: Iterable[Frame], until: float) -> Ride:
        """Up to a time, with the silence after the last frame."""
        for frame in frames:
            self._look_until(min(frame.time, until))
            if frame.time >= until:
                break
            states = self.pipeline.mapper.odometry.states
            before = states[-1] if states else None
            mapped(self.pipeline, "can0", frame.message)
            self._heard = frame.time
            states = self.pipeline.mapper.odometry.states
            if states and states[-1] is not before:
                self.poses.append((frame.time, states[-1].odom_from_base))
        self._look_until(until)
        return self

    def pose(self, time: float) -> SE2:
        """The newest of a time."""
        return self.poses[bisect_right(self.poses, time, key=lambda one: one[0]) - 1][1]

    def _look_until(self, time: float) -> None:
        while (now := len(self.looks) * LOOK) < time:
            state = self.pipeline.state(round((now - self._heard) * 1e9))
            known = self.pipeline.mapper.odometry.states
            pose_time = self.poses[-1][0] if self.poses else 0.0
            self.looks.append(Look(now, state, self.pipeline.mapper.epoch, known[-1].odom_from_base if known else None, pose_time))


def compare(fault: Fault, disturbed: Ride, undisturbed: Ride, frames: Sequence[Frame], start: float, end: float) -> Outcome:
    """`frames`: those without a fault; `start` and `end`: when it was there, s.

    A map that was begun anew is compared with the one that the frames without a fault make from then on.
    """
    since = [look for look in disturbed.looks if look.time >= start]
    noticed = next((look for look in since if fault.is_noticed(look.state, look.epoch)), None)
    found = noticed or next((look for look in since if look.state.name != "ok"), since[0])
    not_ok = [look.time for look in since if look.state.name != "ok"]
    recovered = not_ok[-1] + LOOK if not_ok else start
    return Outcome(
        found.state.name,
        next((reason for reason in found.state.reasons if re.search(fault.reason, reason)), ""),
        None if noticed is None else noticed.time - start,
        None if recovered > since[-1].time else max(recovered - end, 0.0),
        since[-1].epoch,
        pose_error(disturbed, undisturbed),
        map_error(disturbed, _begun_with(disturbed, frames) if since[-1].epoch else undisturbed),
    )


def _begun_with(disturbed: Ride, frames: Sequence[Frame]) -> Ride:
    """A ride without a fault, from where the disturbed one's last map begins."""
    last = disturbed.looks[-1]
    began = next(look.time for look in disturbed.looks if look.epoch == last.epoch and look.pose is not None)
    return Ride(disturbed.pipeline.config.grid.cells).drive([frame for frame in frames if frame.time >= began], last.time)


def pose_error(disturbed: Ride, undisturbed: Ride) -> float:
    """m, the largest: each map's poses from that map's first on, where the state says that they are right."""
    worst = 0.0
    for epoch in {look.epoch for look in disturbed.looks}:
        looks = [look for look in disturbed.looks if look.epoch == epoch and look.pose is not None]
        for look in looks:
            if look.state.name in FRESH and look.pose is not None and looks[0].pose is not None:
                moved = looks[0].pose.inverse() @ look.pose
                truly = undisturbed.pose(looks[0].pose_time).inverse() @ undisturbed.pose(look.pose_time)
                worst = max(worst, math.hypot(moved.x - truly.x, moved.y - truly.y))
    return worst


def map_error(disturbed: Ride, undisturbed: Ride) -> float:
    """The undisturbed map is asked at the centres of the disturbed one's cells, by way of the newest poses; NaN where there is none."""
    (row, column, ours), (true_row, true_column, true) = (one.pipeline.mapper.map.whole() for one in (disturbed, undisturbed))
    cell, last = disturbed.pipeline.mapper.map.spec.cell, disturbed.looks[-1]
    if last.pose is None or not ours.size:
        return math.nan
    true_from_ours = undisturbed.pose(last.pose_time) @ last.pose.inverse()
    rows, columns = np.nonzero(ours)
    centres = (np.stack((columns + column, rows + row), axis=1) + 0.5) * cell
    there = np.floor(true_from_ours.apply(centres) / cell + 1e-9).astype(int) - (true_column, true_row)
    inside = ((there >= 0) & (there < (true.shape[1], true.shape[0]))).all(axis=1)
    theirs = true[there[inside, 1], there[inside, 0]]
    differ = np.abs(probability(ours[rows, columns][inside]) - probability(theirs)) > DIFFERENT
    return float(differ[theirs != 0].mean()) if theirs.any() else math.nan
