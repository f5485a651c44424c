"""Frames of wheel speeds, yaw rate and direction of travel into ego motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import can
import numpy as np

from echogrid.can.cadence import JUMP, Cadence
from echogrid.can.database import FrameId, Message
from echogrid.can.dbc import Checksum, Dbc
from echogrid.can.decode import Payloads, SignalLayout, stack
from echogrid.can.profile import FrameCrc, MotionProfile
from echogrid.can.quantity import QuantityReader
from echogrid.config.tables import Motion
from echogrid.core.health import Health
from echogrid.core.kernels.plans import Plan
from echogrid.core.messages import EgoMotion, Floats, Speed, YawRate
from echogrid.errors import EchogridError

REAR = ("rear_left", "rear_right")
CATCH_UP_NS = 250_000_000  # after a jump of time, for frames that waited


class MotionReader:
    """Remembers the message counters and the last known direction of travel."""

    def __init__(self, profile: MotionProfile, dbc: Dbc, config: Motion, health: Health) -> None:
        """Raises EchogridError where the profile names what the DBC does not have, or `wheel_radius`, which turns turn rates into speeds,
        is missing or not needed."""
        wheel_radius = config.wheel_radius
        if profile.wheel_speeds.are_turn_rates and wheel_radius is None:
            raise EchogridError(f"motion.wheel_radius is missing: {dbc.profile} reports turn rates of the wheels")
        if wheel_radius is not None and not profile.wheel_speeds.are_turn_rates:
            raise EchogridError(f"motion.wheel_radius is given, but {dbc.profile} reports speeds, not turn rates")
        self.profile = profile
        self.health = health
        self.metres_per_unit = config.wheel_scale * (wheel_radius if profile.wheel_speeds.are_turn_rates and wheel_radius else 1.0)
        self.yaw_rate_bias = math.radians(config.yaw_rate_bias_deg_s)
        self.wheel_latency_ns = round((profile.wheel_speeds.latency_ms + config.latency_ms) * 1e6)
        self.yaw_latency_ns = round((profile.yaw_rate.latency_ms + config.latency_ms) * 1e6)
        wheels, yaw = profile.wheel_speeds, profile.yaw_rate
        wheel_message = dbc.message(wheels.message, "wheel_speeds.message")
        yaw_message = dbc.message(yaw.message, "yaw_rate.message")
        rear = dict(zip(REAR, (wheels.rear_left, wheels.rear_right), strict=True))
        self.wheels = QuantityReader(dbc, [wheel_message], rear, "wheel_speeds")
        self.yaw_rate = QuantityReader(dbc, [yaw_message], {"yaw_rate": yaw.yaw_rate}, "yaw_rate")
        self.wheel_id, self.yaw_id = wheel_message.id, yaw_message.id
        self.checks = {
            self.wheel_id: FrameCheck(dbc, wheel_message, wheels.counter, wheels.crc, "wheel_speeds"),
            self.yaw_id: FrameCheck(dbc, yaw_message, yaw.counter, yaw.crc, "yaw_rate"),
        }
        self.direction: SignalLayout | None = None
        self.direction_id: FrameId | None = None
        if profile.direction is not None:
            message = dbc.message(profile.direction.message, "direction.message")
            self.direction = dbc.integer(message, profile.direction.signal, "direction.signal")
            self.direction_id = message.id
            self.checks.setdefault(self.direction_id, FrameCheck(dbc, message, None, None, "direction"))
        self.reverse = False

    @property
    def ids(self) -> set[FrameId]:
        """The frames that are read."""
        return set(self.checks)

    def add(self, message: can.Message, received_ns: int) -> list[EgoMotion]:
        """As `read`, of one message. Raises ValueError for one that is too short or wrong as well."""
        frame_id = message.arbitration_id, message.is_extended_id
        check = self.checks[frame_id]
        payload = check.payload(bytes(message.data))
        raw = 0 if self.direction is None or frame_id != self.direction_id else self.direction.raw(payload)
        values = self.values(frame_id, stack([payload], check.length))[0].tolist()
        return self.read(frame_id, values, (check.number(payload), raw), received_ns)

    def values(self, frame_id: FrameId, rows: Payloads) -> Floats:
        """(N, 3) in payloads (N, length) of an id: speeds of the rear wheels and the yaw rate, NaN where it has them not."""
        found = np.full((3, len(rows)), math.nan)
        if frame_id == self.wheel_id:
            found[:2] = list(self.wheels.read(rows).values())
        if frame_id == self.yaw_id:
            found[2] = self.yaw_rate.read(rows)["yaw_rate"]
        return found.T

    def plans(self, frame_id: FrameId) -> tuple[Plan | None, Plan | None] | None:
        """The same for the loops: of the wheels and of the yaw rate, None where it has them not; None where only `values` can."""
        asked = (
            (self.wheels if frame_id == self.wheel_id else None, REAR),
            (self.yaw_rate if frame_id == self.yaw_id else None, ("yaw_rate",)),
        )
        found = [None if reader is None else reader.plan(columns) for reader, columns in asked]
        if any(plan is None and reader is not None for plan, (reader, _) in zip(found, asked, strict=True)):
            return None
        return found[0], found[1]

    def read(self, frame_id: FrameId, values: list[float], counted: Sequence[int], received_ns: int) -> list[EgoMotion]:
        """What a sound frame, with these values, counter and direction in it, says of the motion. Raises ValueError for one that says
        nothing, which changes nothing."""
        left, right, yaw_rate = values
        counter, direction = counted
        check, wheels, turns = self.checks[frame_id], frame_id == self.wheel_id, frame_id == self.yaw_id
        if check.counter is not None and counter == check.last:
            raise ValueError("repeated counter")
        if (wheels and left + right != left + right) or (turns and yaw_rate != yaw_rate):  # not itself: NaN
            raise ValueError("invalid value")
        continues = check.accept(counter, received_ns)
        self.health.lost_frames += check.missing
        if frame_id == self.direction_id and self.profile.direction is not None and direction not in self.profile.direction.unknown:
            self.reverse = direction in self.profile.direction.reverse
        motion: list[EgoMotion] = []
        if continues is None:
            return motion
        if wheels:
            scale = -self.metres_per_unit if self.reverse else self.metres_per_unit
            motion.append(Speed(received_ns - self.wheel_latency_ns, (left + right) / 2 * scale, continues, (right - left) * scale))
        if turns:
            motion.append(YawRate(received_ns - self.yaw_latency_ns, yaw_rate - self.yaw_rate_bias, continues))
        return motion


class FrameCheck:
    """Length, checksum and counter of one message; remembers the counter, and a jump of time that may be a stall of the frames' stamps."""

    def __init__(self, dbc: Dbc, message: Message, counter: str | None, crc: FrameCrc | None, key: str) -> None:
        self.length = message.length
        self.counter = dbc.integer(message, counter, f"{key}.counter") if counter else None
        self.crc: Checksum | None = dbc.checksum(message, crc.signal, crc.algorithm, f"{key}.crc", crc.data_ids) if crc else None
        self.last: int | None = None
        self.missing = 0  # frames between the last two, by their counters
        self._jumped: tuple[int, float] | None = None  # when, and the lag before
        self._cadence = Cadence(self.counter.length) if self.counter is not None else None

    def payload(self, data: bytes) -> bytes:
        """The frame's bytes that are read; raises ValueError if they are bad."""
        payload = data[: self.length]
        if len(payload) < self.length:
            raise ValueError("too short")
        if self.crc is not None and not self.crc.holds(payload):
            raise ValueError("wrong checksum")
        if self.counter is not None and self.counter.raw(payload) == self.last:
            raise ValueError("repeated counter")
        return payload

    def number(self, payload: bytes) -> int:
        """By the counter; 0 without one."""
        return 0 if self.counter is None else self.counter.raw(payload)

    def accept(self, number: int, received_ns: int) -> bool | None:
        """Takes the counter over; False where time has jumped since an earlier frame, None while that is not known.

        An adapter that stamps frames in a process stamps those that waited for it late, all at once: then nothing has jumped.
        """
        cadence = self._cadence
        if cadence is None:
            return True
        before = cadence.lag
        cadence.add(number, received_ns)
        self.last, self.missing = number, cadence.missing
        if self._jumped is None:
            if -JUMP < cadence.lag - before < JUMP:
                return True
            self._jumped = received_ns, before
        since_ns, lag = self._jumped
        caught_up = -JUMP < cadence.lag - lag < JUMP
        if not caught_up and received_ns - since_ns < CATCH_UP_NS:
            return None
        self._jumped = None
        return caught_up
