"""A stretch of the shipped demo drive as frames with their true times, and what is where in them.

The layouts are those of dbc/corner_radar.dbc and dbc/vehicle_motion.dbc; payloads are changed with cantools and zlib, not with the
service's own decoder.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import can

from echogrid.logs.log import Log
from tests.support.frames import MOTION, RADAR, crc8
from tests.support.places import DEMO

RADARS = ("front_left", "front_right", "rear_left", "rear_right")  # radar n's ids are those of the DBC and 16 n
WHEELS, YAW_RATE = 0x100, 0x102


@dataclass(frozen=True, slots=True)
class Frame:
    """`time` (s, from the stretch's start) is when it was really sent; its time stamp may say something else."""

    time: float
    message: can.Message

    @property
    def radar(self) -> int | None:
        """Whose it is; None for ego motion."""
        number = (self.message.arbitration_id - 0x300) // 16
        return number if number >= 0 else None

    @property
    def is_header(self) -> bool:
        return self.message.arbitration_id >= 0x300 and self.message.arbitration_id % 16 == 0

    def stamped(self, shift: float) -> Frame:
        """With another time stamp, `shift` s later."""
        return Frame(self.time, _copy(self.message, self.message.data, self.message.timestamp + shift))

    def later(self, delay: float) -> Frame:
        """Sent later."""
        return Frame(self.time + delay, _copy(self.message, self.message.data, self.message.timestamp + delay))

    def carrying(self, data: bytes) -> Frame:
        return Frame(self.time, _copy(self.message, data, self.message.timestamp))

    def of_radar(self, number: int) -> Frame:
        """The same frame with another radar's id."""
        message = _copy(self.message, self.message.data, self.message.timestamp)
        message.arbitration_id = 0x300 + 16 * number + self.message.arbitration_id % 16
        return Frame(self.time, message)


@cache
def stretch(first: float, seconds: float) -> tuple[Frame, ...]:
    """The demo's frames that the service reads, from `first` s on."""
    frames, began = [], None
    for message in Log(DEMO / "can.log.gz"):
        began = message.timestamp if began is None else began
        time = message.timestamp - began - first
        if time >= seconds:
            break
        if time >= 0 and message.arbitration_id != 0x101:
            frames.append(Frame(time, message))
    return tuple(frames)


def motion_with(frame: Frame, **values: float) -> Frame:
    """A wheel or yaw-rate frame with other values of its signals, its checksum put right."""
    message = MOTION.get_message_by_frame_id(frame.message.arbitration_id)
    decoded: dict[str, Any] = message.decode(frame.message.data, decode_choices=False)
    data = message.encode({**decoded, **values}, strict=False)
    return frame.carrying(bytes((crc8(data[1:]),)) + data[1:])


def wheels_of(frame: Frame) -> tuple[float, float]:
    """m/s, of the left and the right rear wheel."""
    decoded = MOTION.decode_message(WHEELS, frame.message.data)
    return float(decoded["WheelSpeedRL"]), float(decoded["WheelSpeedRR"])


def yaw_rate_of(frame: Frame) -> float:
    return float(MOTION.decode_message(YAW_RATE, frame.message.data)["YawRate"])


def cycles_of(frames: tuple[Frame, ...], radar: int) -> list[list[Frame]]:
    """A radar's frames cycle by cycle: header and pages."""
    cycles: list[list[Frame]] = []
    for frame in frames:
        if frame.radar == radar:
            if frame.is_header:
                cycles.append([])
            if cycles:
                cycles[-1].append(frame)
    return cycles


def cycle_with(
    cycle: list[Frame], header: dict[str, float] | None = None, change: Callable[[dict[str, Any]], dict[str, Any]] | None = None
) -> list[Frame]:
    """A cycle with other header values, and with its pages' signals changed; pages beyond the count are left out, the checksum is right."""
    head: dict[str, Any] = RADAR.get_message_by_name("RadarHeader").decode(cycle[0].message.data, decode_choices=False)
    head |= header or {}
    pages = cycle[1 : 1 + -(-int(head["DetectionCount"]) // 8)]
    message = RADAR.get_message_by_name("RadarDetections")
    if change is not None:
        decoded = [message.decode(page.message.data, decode_choices=False) for page in pages]
        pages = [page.carrying(message.encode(change(values), strict=False)) for page, values in zip(pages, decoded, strict=True)]
    payload = RADAR.encode_message("RadarHeader", head, strict=False)
    summed = payload[:8] + payload[12:] + b"".join(bytes(page.message.data) for page in pages)
    head["Crc"] = zlib.crc32(summed)
    return [cycle[0].carrying(RADAR.encode_message("RadarHeader", head, strict=False)), *pages]


def _copy(message: can.Message, data: bytes | bytearray, timestamp: float) -> can.Message:
    return can.Message(
        timestamp=timestamp,
        arbitration_id=message.arbitration_id,
        is_extended_id=False,
        channel=message.channel,
        data=bytes(data),
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )
