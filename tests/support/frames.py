"""CAN frames for tests, encoded by cantools and checksummed by definition: independent of the service's own decoding."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from functools import cache

import can
import cantools
from tests.support.places import DBC

RADAR = cantools.database.load_file(DBC / "corner_radar.dbc")
CLASSIC = cantools.database.load_file(DBC / "corner_radar_classic.dbc")
MOTION = cantools.database.load_file(DBC / "vehicle_motion.dbc")

Detection = tuple[float, float, float]  # range m, azimuth rad, range rate m/s


@cache
def crc_table(bits: int, polynomial: int) -> list[int]:
    """What each byte leaves in a CRC's register, by its definition, bit for bit."""
    mask, table = (1 << bits) - 1, []
    for byte in range(256):
        register = byte << (bits - 8)
        for _ in range(8):
            register = (register << 1 & mask) ^ (polynomial if register >> (bits - 1) else 0)
        table.append(register)
    return table


def crc(data: bytes, bits: int, polynomial: int, start: int) -> int:
    """A CRC that is neither reflected nor inverted at the end."""
    table, mask, register = crc_table(bits, polynomial), (1 << bits) - 1, start
    for byte in data:
        register = (register << 8 & mask) ^ table[register >> (bits - 8) ^ byte]
    return register


def crc8(data: bytes) -> int:
    """SAE J1850."""
    return crc(data, 8, 0x1D, 0xFF) ^ 0xFF


def crc16(data: bytes) -> int:
    """IBM-3740."""
    return crc(data, 16, 0x1021, 0xFFFF)


def frame(identifier: int, data: bytes, time: float, channel: str = "can0", fd: bool = False) -> can.Message:
    return can.Message(
        arbitration_id=identifier, data=data, timestamp=time, channel=channel, is_fd=fd, bitrate_switch=fd, is_extended_id=False
    )


def radar_cycle(
    detections: Sequence[Detection], cycle: int, time: float, *, offset: int = 0, age_ms: float = 20.0, rcs: float = -10.0
) -> list[can.Message]:
    """Header and pages of one cycle of the CAN FD radar; `time` is when the header is received."""
    pages = []
    for page in range(math.ceil(len(detections) / 8)):
        values: dict[str, float] = {"CycleCounter": cycle % 256, "Page": page}
        for k in range(1, 9):
            index = page * 8 + k - 1
            there = index < len(detections)
            range_, azimuth, range_rate = detections[index] if there else (0.0, 0.0, 0.0)
            values |= {f"Range_{k}": range_, f"Azimuth_{k}": azimuth, f"RangeRate_{k}": range_rate}
            values |= {f"Rcs_{k}": rcs if there else 0.0, f"Quality_{k}": 31, f"Valid_{k}": int(there)}
        pages.append(RADAR.encode_message("RadarDetections", values, strict=False))
    header = {"CycleCounter": cycle % 256, "DetectionCount": len(detections), "MeasurementAge": age_ms}
    header |= {"AmbiguityInterval": 0, "Blockage": 0, "Crc": 0}
    summed = RADAR.encode_message("RadarHeader", header)
    summed = summed[:8] + summed[12:] + b"".join(pages)
    header["Crc"] = zlib.crc32(summed)
    payload = RADAR.encode_message("RadarHeader", header)
    messages = [frame(0x300 + offset, payload, time, fd=True)]
    return messages + [frame(0x301 + offset, page, time + 0.0003 * (n + 1), fd=True) for n, page in enumerate(pages)]


def classic_cycle(detections: Sequence[Detection], cycle: int, time: float, *, offset: int = 0, age_ms: float = 20.0) -> list[can.Message]:
    """Header and detections of one cycle of the classic-CAN radar."""
    payloads = [
        CLASSIC.encode_message(
            f"RadarDetection_{n:02d}",
            {"CycleCounter": cycle % 256, "Range": r, "Azimuth": a, "RangeRate": v, "Rcs": -10.0, "Quality": 31, "Valid": 1},
        )
        for n, (r, a, v) in enumerate(detections, 1)
    ]
    header = {"CycleCounter": cycle % 256, "DetectionCount": len(detections), "MeasurementAge": age_ms}
    header |= {"AmbiguityInterval": 0, "Blockage": 0, "Crc": 0}
    header["Crc"] = crc16(CLASSIC.encode_message("RadarHeader", header)[:6] + b"".join(payloads))
    messages = [frame(0x300 + offset, CLASSIC.encode_message("RadarHeader", header), time)]
    return messages + [frame(0x301 + offset + n, payload, time + 0.0003 * (n + 1)) for n, payload in enumerate(payloads)]


def wheel_speeds(speed: float, counter: int, time: float) -> can.Message:
    """The rear wheels, both at `speed` (m/s, negative in reverse)."""
    values = {"Crc": 0, "Counter": counter % 16, "DirectionOfTravel": 2 if speed < 0 else 1}
    values |= {"WheelSpeedRL": abs(speed), "WheelSpeedRR": abs(speed), "WheelSpeedRLValid": 1, "WheelSpeedRRValid": 1}
    return frame(0x100, _with_crc8("WheelSpeedsRear", values), time)


def yaw_rate(rate: float, counter: int, time: float) -> can.Message:
    values = {"Crc": 0, "Counter": counter % 16, "YawRateValid": 1, "YawRate": rate}
    return frame(0x102, _with_crc8("YawRate", values), time)


def _with_crc8(name: str, values: dict[str, float]) -> bytes:
    values["Crc"] = crc8(MOTION.encode_message(name, values)[1:])
    return bytes(MOTION.encode_message(name, values))


CONFIG = """
vehicle = "test"
model = "analytic"

[[bus]]
name = "can0"
interface = "virtual"
channel = "can0"

[motion]
bus = "can0"

[[radar]]
name = "front_left"
bus = "can0"
x = 3.6
y = 0.8
yaw_deg = 45.0
"""


# Of every kind, as a log may hold them.
FRAMES = [*(wheel_speeds(3.0, n, 1732547000.1234567 + n / 100) for n in range(20)), *radar_cycle([(5.0, 0.1, -1.0)] * 20, 1, 1732547000.2)]
FRAMES += [can.Message(timestamp=1732547000.2, arbitration_id=0x18DAF110, is_remote_frame=True, dlc=8, channel=1)]
FRAMES += [can.Message(timestamp=1732547000.1, arbitration_id=4, is_error_frame=True, is_rx=False, dlc=8, data=bytes(8), channel=None)]
