"""All that is to be seen at one moment: what it is told becomes frames for those who watch, and it can tell newcomers everything."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from echogrid.core.motion.se2 import SE2
from echogrid.topics.diagnostics import diagnostics
from echogrid.topics.grids import Grid
from echogrid.viewing import wire
from echogrid.viewing.canvas import Canvas
from echogrid.viewing.wire import Kind, Plane

REACH = 300.0  # m around the car of which newcomers are told; a page keeps more
TRAIL_STEP, MOST_TRAIL = 0.5, 8192  # m between points of the trail; so many of them, so some kilometres
MOST_POSES = 8  # that are remembered, for the detections of the same stamp
TIDY = 64  # windows between two looks for what is out of reach
Frames = list[bytes]


class Scene:
    """Remembers the newest of everything. One thread tells it, and asks for `whole`."""

    def __init__(self, source: Mapping[str, Any]) -> None:
        """`source`: what the page says about where it all comes from: `shown` ("live", "drive" or "map"), `name`, `planes`, `timeline`."""
        self.canvas = Canvas()
        self.cell: float | None = None
        self.source = dict(source)
        self._meta: Mapping[str, Any] = {}
        self._map: object = None  # what names it
        self._poses: dict[int, SE2] = {}  # the newest ones by their stamps
        self._newest: dict[Kind, bytes] = {}
        self._trail: list[tuple[float, float]] = []
        self._true_trail: bytes | None = None
        self._windows = 0

    def whole(self) -> Frames:
        """Everything, for one who knows nothing."""
        frames = [self._hello(), wire.reset()]
        for plane, known in self.canvas.planes.items():
            frames += wire.blocks(plane, known)
        frames += [wire.trail(self._trail)] + ([] if self._true_trail is None else [self._true_trail])
        return frames + list(self._newest.values())

    @property
    def place(self) -> tuple[float, float] | None:
        """x and y of the car in odom, m."""
        pose = self._newest_pose()
        return None if pose is None else (pose.x, pose.y)

    def meta(self, meta: Mapping[str, Any]) -> Frames:
        """What stays the same while a service runs; see docs/interface.md."""
        if meta == self._meta:
            return []
        self._meta = dict(meta)
        return [self._hello()]

    def window(self, grid: Grid, name: object, plane: Plane = Plane.OCCUPANCY) -> Frames:
        """A part of the map called `name`: another one begins where it is not the last one's."""
        frames: Frames = []
        if name != self._map or (self.cell is not None and not math.isclose(self.cell, grid.cell, rel_tol=1e-6)):
            frames += self._begin(name)
        if self.cell is None:
            self.cell = grid.cell
            frames.append(self._hello())
        row, column = round(grid.origin[1] / grid.cell), round(grid.origin[0] / grid.cell)
        frames += self.cells(plane, row, column, grid.occupancy)
        self._windows += 1
        if self._windows % TIDY == 0:
            height, width = grid.occupancy.shape
            self.canvas.keep_near(row + height // 2, column + width // 2, round(REACH / grid.cell))
        return frames

    def cells(self, plane: Plane, row: int, column: int, cells: NDArray[Any]) -> Frames:
        """The same by its place in the map, whatever it says of the cells."""
        return wire.blocks(plane, self.canvas.put(plane, row, column, cells))

    def pose(self, stamp_ns: int, pose: SE2, speed: float, yaw_rate: float) -> Frames:
        """Where the car is."""
        self._poses.pop(stamp_ns, None)
        self._poses[stamp_ns] = pose
        if len(self._poses) > MOST_POSES:
            del self._poses[next(iter(self._poses))]
        if not self._trail or math.dist(self._trail[-1], (pose.x, pose.y)) >= TRAIL_STEP:
            self._trail.append((pose.x, pose.y))
            del self._trail[:-MOST_TRAIL]
        return [self._keep(Kind.POSE, wire.pose(stamp_ns, pose.x, pose.y, pose.yaw, speed, yaw_rate))]

    def detections(self, stamp_ns: int, points: NDArray[Any], radars: NDArray[np.uint8], verdicts: NDArray[np.uint8]) -> Frames:
        """Points (N, 2) or (N, 3) in base, which is where the pose of the same stamp says, or else the newest."""
        pose = self._poses.get(stamp_ns) or self._newest_pose()
        if pose is None:
            return []
        places = pose.apply(np.asarray(points, float)[:, :2])
        return [self._keep(Kind.POINTS, wire.points(stamp_ns, places.astype(np.float32), radars, verdicts))]

    def status(self, status: Mapping[str, Any], stamp_ns: int) -> Frames:
        """How the service is doing, with the level of each of its parts as ROS's diagnostics have it."""
        return [
            self._keep(Kind.STATUS, wire.document(Kind.STATUS, {**status, "parts": parts(status, stamp_ns), "stamp_s": stamp_ns * 1e-9}))
        ]

    def truth(self, trail: NDArray[Any], cells: NDArray[np.int8] | None, row: int, column: int) -> Frames:
        """The true way (N, 2) and the true map, in odom, once."""
        self._true_trail = wire.trail(trail, true=True)
        return [self._true_trail] + ([] if cells is None else self.cells(Plane.TRUTH, row, column, cells))

    def _begin(self, name: object) -> Frames:
        first, self._map = self._map is None, name
        if first:
            return []
        self.canvas.clear()
        self._trail.clear()
        self._newest.pop(Kind.POINTS, None)
        self.cell = None
        return [wire.reset()]

    def _newest_pose(self) -> SE2 | None:
        return next(reversed(self._poses.values()), None)

    def _hello(self) -> bytes:
        told = {key: self._meta.get(key) for key in ("vehicle", "version", "model", "body", "radars")}
        return wire.document(Kind.HELLO, {**told, **self.source, "cell": self.cell, "block": wire.SIDE})

    def _keep(self, kind: Kind, frame: bytes) -> bytes:
        self._newest[kind] = frame
        return frame


def parts(status: Mapping[str, Any], stamp_ns: int) -> list[dict[str, Any]]:
    """Name, level (0 ok, 1 warning, 2 error, 3 stale) and message of the service, motion, each radar and each bus; none where another
    version's status does not say."""
    try:
        told = diagnostics(status, "", stamp_ns).status
    except (KeyError, TypeError, AttributeError, ValueError):
        return []
    return [{"name": part.name.partition(": ")[2], "level": int(part.level), "said": part.message} for part in told]
