"""Map updates, status and diagnostics as messages, each encoded once for all who take them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid import __version__
from echogrid.config.tables import Config, Publish
from echogrid.core.kernels.dispatch import loops
from echogrid.core.map.map_delta import NOTHING, Rectangle, around, changed, key_window
from echogrid.core.map.tile import SIDE
from echogrid.core.map.tiled_map import FREE, OCCUPIED, LogOdds
from echogrid.core.mapper import Mapper, MapUpdate
from echogrid.core.messages import Floats
from echogrid.core.motion.error_filter import Certainty
from echogrid.topics.cdr import encode_header
from echogrid.topics.diagnostic_array import encode_diagnostics
from echogrid.topics.diagnostics import diagnostics
from echogrid.topics.grids import Grid, GridUpdate, encode_grid, encode_update
from echogrid.topics.points import JudgedPoints, Points, encode_judged, encode_points
from echogrid.topics.poses import PLANE, WAY, Odometry, Transform, encode_odometry, encode_transforms, spread
from echogrid.topics.topic import (
    DETECTIONS,
    DIAGNOSTICS,
    FULL,
    JUDGED,
    KEY,
    META,
    ODOMETRY,
    STATUS,
    TOPICS,
    TRANSFORM,
    TRINARY,
    UPDATE,
    Message,
    Topic,
)

MAP_FRAME, CAR_FRAME, FIXED_FRAME = "odom", "base", "map"  # FIXED_FRAME: of poses from outside
OCCUPIED_FROM, FREE_UP_TO = round(100 * OCCUPIED), round(100 * FREE)  # percent, as map.yaml has it
KEY_PERIOD_NS = 1_000_000_000  # a key frame goes out at the latest with the first window that is so much younger than the last one


# Of each percent, as a byte: free, occupied, neither surely.
_TRINARY = bytes(0 if cell <= FREE_UP_TO else 100 if OCCUPIED_FROM <= cell < 128 else 255 for cell in range(256))

Wanted = Callable[[Topic], bool]
MAPPED = (ODOMETRY, TRANSFORM, DETECTIONS, JUDGED, KEY, TRINARY, UPDATE, FULL)  # what a snapshot becomes


def everything(_: Topic) -> bool:
    """Whatever there is, is wanted."""
    return True


class Snapshot(msgspec.Struct, frozen=True, eq=False):
    """What the map around the car was after an update: enough for the window around it and for its key frame."""

    update: MapUpdate
    certainty: Certainty  # of the car's motion, then
    epoch: int
    window: Rectangle  # around the car
    key: Rectangle  # its key window
    seen: Rectangle  # holds both
    log_odds: LogOdds  # of `seen`


class Snapshots:
    """Taken of the map, one in each of the periods of `rate_hz` that the traffic's own time falls into; remembers the last one's.

    While nobody listens, one a second for those who come late; then the newest update that none was taken of is remembered too.
    """

    def __init__(self) -> None:
        self.taken: tuple[bool, int] | None = None
        self.left: MapUpdate | None = None

    def take(self, mapper: Mapper, update: MapUpdate, settings: Publish, *, listened: bool = True) -> Snapshot | None:
        """After an update, in the thread that maps; None where the next one is not due."""
        length_ns = round(1e9 / settings.rate_hz) if listened else KEY_PERIOD_NS
        period = listened, update.ego.stamp_ns // length_ns  # stamps jitter: since the last one it may be a little too short
        if period == self.taken:
            self.left = None if listened else update
            return None
        self.taken, self.left = period, None
        return self._of(mapper, update, settings)

    def late(self, mapper: Mapper, settings: Publish) -> Snapshot | None:
        """Of the newest update, where none was taken of it since nobody listened."""
        left, self.left = self.left, None
        return None if left is None else self._of(mapper, left, settings)

    def _of(self, mapper: Mapper, update: MapUpdate, settings: Publish) -> Snapshot:
        window = around(update.ego.odom_from_base, mapper.map.spec.cell, settings.window_cells)
        key = key_window(window)
        seen = window.joined(key)
        return Snapshot(update, mapper.certainty(update.ego), mapper.epoch, window, key, seen, mapper.map.window(*seen))


class Announcer:
    """Remembers the key frame, and where the map has differed from it since. One thread.

    An update holds the rectangle of all cells that have differed from its key frame since that went out, so it takes the place of every
    earlier one for the same key frame: what was lost heals with the next, also where updates are laid over each other, as RViz does.
    """

    def __init__(self, config: Config, model: str) -> None:
        """`model`: which one runs, and why."""
        self.config = config
        self.model = model
        self.keyframe = 0  # number of the newest, from 1
        self._key_ns = 0  # its stamp
        self._key_of: tuple[int, Rectangle] | None = None  # its epoch and window
        self._key_cells = np.zeros((0, 0), dtype=np.int8)
        self._differed = NOTHING  # within the window

    def map(self, snapshot: Snapshot, wanted: Wanted = everything) -> Iterator[Message]:
        """Odometry, transform, detections, key frame or update, and the whole window; of those only what is wanted or kept."""
        ego, epoch = snapshot.update.ego, snapshot.epoch
        stamp_ns = ego.stamp_ns

        def message(topic: Topic, payload: bytes, keyframe: int = 0) -> Message:
            return Message(topic, payload, stamp_ns, epoch, keyframe)

        if wanted(ODOMETRY):
            known = snapshot.certainty
            covariances = spread(known.pose, PLANE), spread(known.motion, WAY)
            odometry = Odometry(stamp_ns, MAP_FRAME, CAR_FRAME, ego.odom_from_base, ego.speed, ego.yaw_rate, *covariances)
            yield message(ODOMETRY, encode_odometry(odometry))
        if wanted(TRANSFORM):
            transforms = [Transform(stamp_ns, MAP_FRAME, CAR_FRAME, ego.odom_from_base)]
            if snapshot.update.map_from_odom is not None:
                transforms.append(Transform(stamp_ns, FIXED_FRAME, MAP_FRAME, snapshot.update.map_from_odom))
            yield message(TRANSFORM, encode_transforms(transforms))
        if wanted(DETECTIONS):
            yield message(DETECTIONS, encode_points(Points(stamp_ns, CAR_FRAME, on_the_ground(snapshot.update.static_points))))
        if wanted(JUDGED):
            points, radars, verdicts = snapshot.update.judged.near()
            yield message(JUDGED, encode_judged(JudgedPoints(stamp_ns, CAR_FRAME, on_the_ground(points), radars, verdicts)))
        seen = occupancy_percent(snapshot.log_odds)
        key = snapshot.key
        cells = seen[key.within(snapshot.seen)]
        if self._key_of != (epoch, key) or not 0 <= stamp_ns - self._key_ns < KEY_PERIOD_NS:
            self.keyframe += 1
            self._key_ns, self._key_of, self._key_cells, self._differed = stamp_ns, (epoch, key), cells, NOTHING
            yield message(KEY, self._grid(stamp_ns, key, cells), self.keyframe)
            yield message(TRINARY, self._grid(stamp_ns, key, trinary(cells)), self.keyframe)
        elif wanted(UPDATE):  # who did not take the last ones needs no more than what differs now
            self._differed = self._differed.joined(changed(self._key_cells, cells))
            x, y = self._differed.column, self._differed.row
            update = GridUpdate(stamp_ns, MAP_FRAME, x, y, cells[self._differed.within(Rectangle(0, 0, *cells.shape))])
            yield message(UPDATE, encode_update(update), self.keyframe)
        yield message(FULL, self._grid(stamp_ns, snapshot.window, seen[snapshot.window.within(snapshot.seen)]))

    def status(self, status: Mapping[str, Any], stamp_ns: int, wanted: Wanted = everything) -> Iterator[Message]:
        """The service's status, taken at `stamp_ns`, for programs, and for ROS where that is wanted.

        Raises StampError in either case: that the clock is wrong is said at once, not when the first node listens.
        """
        encode_header(stamp_ns, "")
        epoch = status["epoch"]
        yield Message(STATUS, msgspec.json.encode(status), stamp_ns, epoch, 0)
        if wanted(DIAGNOSTICS):
            yield Message(DIAGNOSTICS, encode_diagnostics(diagnostics(status, self.config.vehicle, stamp_ns)), stamp_ns, epoch, 0)

    def about(self) -> dict[str, Any]:
        """What does not change while the service runs."""
        config = self.config
        radars = [
            {key: getattr(radar, key) for key in ("name", "x", "y", "yaw_deg", "fov_deg", "max_range")}  # m and degrees in base
            for radar in config.radar
        ]
        return {
            "vehicle": config.vehicle,
            "version": __version__,
            "model": self.model,
            "frames": {"map": MAP_FRAME, "car": CAR_FRAME} | ({} if config.pose is None else {"fixed": FIXED_FRAME}),
            "grid": {"cell": config.grid.cell, "tile_cells": SIDE},
            "body": {key: getattr(config.body, key) for key in ("length", "width", "rear_overhang")},
            "radars": radars,
            "keys": {topic.name: topic.type or "JSON" for topic in TOPICS},
        }

    def meta(self, stamp_ns: int) -> Message:
        """`about` as a message."""
        return Message(META, msgspec.json.encode(self.about()), stamp_ns, 0, 0)

    def _grid(self, stamp_ns: int, window: Rectangle, cells: NDArray[np.int8]) -> bytes:
        cell = self.config.grid.cell
        return encode_grid(Grid(stamp_ns, MAP_FRAME, cell, (window.column * cell, window.row * cell), cells))


def on_the_ground(points: Floats) -> NDArray[np.float32]:
    """(N, 2) as (N, 3) with z = 0."""
    standing = np.zeros((len(points), 3), dtype=np.float32)
    standing[:, :2] = points
    return standing


def occupancy_percent(log_odds: LogOdds) -> NDArray[np.int8]:
    """nav_msgs/OccupancyGrid's cells of log-odds, same shape: round(100 p), -1 where the log-odds are 0: never seen."""
    percent = np.empty(log_odds.shape, dtype=np.int8)
    loops.percent(log_odds, percent)
    return percent


def trinary(percent: NDArray[np.int8]) -> NDArray[np.int8]:
    """100, 0 or -1 of each of `occupancy_percent`'s cells: occupied, free, neither surely; for who takes nothing below 100 for occupied."""
    return np.frombuffer(percent.tobytes().translate(_TRINARY), np.int8).reshape(percent.shape)
