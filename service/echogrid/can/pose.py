"""Frames of another odometry or a satellite receiver into poses from outside."""

from __future__ import annotations

import math

import can

from echogrid.can.database import FrameId
from echogrid.can.dbc import Dbc
from echogrid.can.decode import stack
from echogrid.can.motion import FrameCheck
from echogrid.can.profile import PoseProfile
from echogrid.can.quantity import QuantityReader
from echogrid.config.tables import Pose
from echogrid.core.health import PoseHealth
from echogrid.core.messages import PoseFix
from echogrid.core.motion.tangent_plane import TangentPlane
from echogrid.errors import EchogridError

HELD_NS = 500_000_000  # a heading serves for places for so long: each has its own time, so nothing is wrong with an older one
FARTHEST = 1e6  # m: a pose that is farther from the map frame's origin is none
FARTHEST_ON_PLANE = 1e5  # m: where the earth is round


class PoseReader:
    """Remembers the newest heading and place, and the message counters."""

    def __init__(self, profile: PoseProfile, dbc: Dbc, config: Pose, counts: PoseHealth) -> None:
        """Raises EchogridError where the profile names what the DBC does not have, or `origin`, about which latitude and longitude are
        turned into metres, is missing or not needed."""
        place, heading = profile.place, profile.heading
        if place.is_on_earth and config.origin is None:
            raise EchogridError(f"pose.origin is missing: {dbc.profile} reports latitude and longitude, expected those of the map's origin")
        if config.origin is not None and not place.is_on_earth:
            raise EchogridError(f"pose.origin is given, but {dbc.profile} reports metres, not latitude and longitude")
        self.counts = counts
        self.plane = None if config.origin is None else TangentPlane(*map(math.radians, config.origin))
        place_message = dbc.message(place.message, "place.message")
        heading_message = place_message if heading.message is None else dbc.message(heading.message, "heading.message")
        self.place_id, self.heading_id = place_message.id, heading_message.id
        self.place = QuantityReader(dbc, [place_message], place.quantities, "place")
        self.heading = QuantityReader(dbc, [heading_message], {"yaw": heading.yaw}, "heading")
        self.place_latency_ns = round((place.latency_ms + config.latency_ms) * 1e6)
        own = place.latency_ms if heading.message is None else heading.latency_ms
        self.heading_latency_ns = round((own + config.latency_ms) * 1e6)
        self.checks = {self.heading_id: FrameCheck(dbc, heading_message, heading.counter, heading.crc, "heading")}
        self.checks[self.place_id] = FrameCheck(dbc, place_message, place.counter, place.crc, "place")
        self._yaw: tuple[int, float] | None = None  # when, and rad
        self._at: tuple[float, float] | None = None  # latitude and longitude (rad) of the newest place

    @property
    def ids(self) -> set[FrameId]:
        """The frames that are read."""
        return set(self.checks)

    def add(self, message: can.Message, received_ns: int) -> list[PoseFix]:
        """As `read`."""
        return self.read((message.arbitration_id, message.is_extended_id), bytes(message.data), received_ns)

    def swapped(self) -> bool:
        """Whether the newest place is nowhere near, and would be with its latitude and longitude in each other's place."""
        if self.plane is None or self._at is None:
            return False
        latitude, longitude = self._at
        return math.hypot(*self.plane.place(latitude, longitude)) > FARTHEST_ON_PLANE > math.hypot(*self.plane.place(longitude, latitude))

    def read(self, frame_id: FrameId, data: bytes, received_ns: int) -> list[PoseFix]:
        """What the frame says of the pose. Raises ValueError for a bad frame, which changes nothing; values that are none are counted."""
        check = self.checks[frame_id]
        payload = check.payload(data)
        check.accept(check.number(payload), received_ns)
        found: list[PoseFix] = []
        if frame_id == self.heading_id:
            yaw = float(self.heading.read(stack([payload], check.length))["yaw"][0])
            self._yaw = (received_ns - self.heading_latency_ns, yaw) if math.isfinite(yaw) else None
            self.counts.invalid += self._yaw is None
        if frame_id == self.place_id:
            stamp_ns, place = received_ns - self.place_latency_ns, self._placed(payload)
            if place is not None and self._yaw is not None and abs(stamp_ns - self._yaw[0]) <= HELD_NS:
                yaw_ns, yaw = self._yaw
                found.append(PoseFix(stamp_ns, *place, yaw_ns, self._turned(yaw)))
        return found

    def _placed(self, payload: bytes) -> tuple[float, float] | None:
        """m in the map frame; None, and counted, where it is nowhere."""
        values = self.place.read(stack([payload], len(payload)))
        first, second = (float(values[name][0]) for name in values)
        place, farthest = (first, second), FARTHEST
        if self.plane is not None:
            self._at = first, second
            place, farthest = self.plane.place(first, second), FARTHEST_ON_PLANE
        if math.hypot(*place) <= farthest:  # not so where it is not a number
            return place
        self.counts.invalid += 1
        return None

    def _turned(self, yaw: float) -> float:
        return yaw if self.plane is None or self._at is None else self.plane.yaw(*self._at, yaw)
