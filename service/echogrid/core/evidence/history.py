"""The static detections of the last metres of way, and from where the radars looked: what a network is shown beside the newest scans."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.kernels.dispatch import loops
from echogrid.core.messages import Floats
from echogrid.core.motion.se2 import SE2
from echogrid.core.radar.mount import Mount

LENGTH = 15.0  # m of way, the paper's half patch
MOST_UPDATES = 160  # on a turntable no way is made: there, so many map updates


class Detections(msgspec.Struct, frozen=True, eq=False):
    """Static detections in one frame."""

    points: Floats  # (N, 2) m
    origins: Floats  # (N, 2) m, of the radars that measured them
    rcs: Floats  # (N,) dBsm; NaN where the sensor reports none
    deviation: Floats  # (N,) of the range rate from a standing thing's, in sigmas

    def __len__(self) -> int:
        return len(self.points)

    def taken(self, some: NDArray[np.int64]) -> Detections:
        """Those of these numbers."""
        return Detections(self.points.take(some, axis=0), self.origins.take(some, axis=0), self.rcs.take(some), self.deviation.take(some))


class Looks(msgspec.Struct, frozen=True, eq=False):
    """From where radars looked, and how wide and far, in one frame: a row for each scan."""

    place: Floats  # (S, 3) x, y (m) and yaw (rad) of the sensors
    half_fov: Floats  # (S,) rad
    max_range: Floats  # (S,) m

    @staticmethod
    def of(mounts: Sequence[Mount], base_from_there: Sequence[SE2]) -> Looks:
        """One scan of each mount, taken when base was `there`."""
        sensors = [pose @ mount.base_from_sensor for mount, pose in zip(mounts, base_from_there, strict=True)]
        return Looks(
            np.array([(sensor.x, sensor.y, sensor.yaw) for sensor in sensors]).reshape(-1, 3),
            np.array([mount.half_fov for mount in mounts], dtype=float),
            np.array([mount.max_range for mount in mounts], dtype=float),
        )


class Surroundings(msgspec.Struct, frozen=True, eq=False):
    """All that one map update knows about the surroundings of the car, in base at the update's time."""

    now: Detections  # of the newest scans
    past: Detections  # of the last LENGTH m, the newest scans included
    age: Floats  # (len(past),) m of way since they were measured
    update: NDArray[np.int64]  # (len(past),) number of the map update that they came with
    looks: Looks  # of all scans in `past`
    live: Sequence[str]  # radars that are heard, by name


class History:
    """Remembers what the last map updates saw, in odom."""

    def __init__(self) -> None:
        self.updates = 0
        self._entries: deque[tuple[float, int, int]] = deque()  # of an update: m travelled at that time, detections, looks
        self._detections = _Rows((2,), (2,), (), (), (), ())  # as the fields of Detections, m travelled, number of the update
        self._looks = _Rows((3,), (), ())  # as those of Looks

    def add(self, detections: Detections, looks: Looks, distance: float) -> None:
        """What the update at `distance` (m, travelled) saw, in odom."""
        more, scans = len(detections.points), len(looks.place)
        seen = (detections.points, detections.origins, detections.rcs, detections.deviation)
        self._detections.add(more, *seen, distance, self.updates)
        self._looks.add(scans, looks.place, looks.half_fov, looks.max_range)
        self._entries.append((distance, more, scans))
        self.updates += 1
        while self._entries[0][0] < distance - LENGTH or len(self._entries) > MOST_UPDATES:
            _, fewer, less = self._entries.popleft()
            self._detections.drop(fewer)
            self._looks.drop(less)

    def surroundings(self, odom_from_base: SE2, live: Sequence[str]) -> Surroundings:
        """As seen from the pose of the update added last. At least one must have been added."""
        distance, count, _ = self._entries[-1]
        points, origins, rcs, deviation, travelled, update = self._detections.rows()
        sensors, half_fov, max_range = self._looks.rows()
        size = len(rcs)
        places, age, numbers, place = np.empty((2, size, 2)), np.empty(size), np.empty(size, np.int64), np.empty(sensors.shape)
        loops.recalled(points, origins, travelled, update, sensors, *odom_from_base, distance, places, age, numbers, place)
        past = Detections(places[0], places[1], rcs.copy(), deviation.copy())
        newest = slice(size - count, None)
        return Surroundings(
            now=Detections(past.points[newest], past.origins[newest], past.rcs[newest], past.deviation[newest]),
            past=past,
            age=age,
            update=numbers,
            looks=Looks(place, half_fov.copy(), max_range.copy()),
            live=live,
        )


class _Rows:
    """Arrays with as many rows each: new ones come at the end, the oldest go, and what stays is seldom moved."""

    def __init__(self, *widths: tuple[int, ...]) -> None:
        self._arrays = [np.empty((256, *width)) for width in widths]
        self._room = 256
        self._begin = self._end = 0

    def add(self, more: int, *arrays: Floats | float) -> None:
        """So many rows behind the last; a number stands in all of them."""
        if self._end + more > self._room:
            kept = [rows.copy() for rows in self.rows()]
            self._begin, self._end = 0, len(kept[0])
            if 2 * (self._end + more) > self._room:
                self._room = 2 * (self._end + more)
                self._arrays = [np.empty((self._room, *old.shape[1:])) for old in kept]
            for array, old in zip(self._arrays, kept, strict=True):
                array[: self._end] = old
        for array, new in zip(self._arrays, arrays, strict=True):
            array[self._end : self._end + more] = new
        self._end += more

    def drop(self, count: int) -> None:
        """The oldest."""
        self._begin += count

    def rows(self) -> list[Floats]:
        """All of them, until the next change."""
        return [array[self._begin : self._end] for array in self._arrays]
