"""Poses from outside as CAN frames: a receiver of our own making, in metres, and another with latitude and longitude."""

from __future__ import annotations

from pathlib import Path

import can
import cantools
from tests.support.frames import crc8, frame

DBC = """VERSION ""

BU_:

BO_ 512 Place: 14 Vector__XXX
 SG_ X : 0|32@1- (0.001,0) [-2147483|2147483] "m" Vector__XXX
 SG_ Y : 32|32@1- (0.001,0) [-2147483|2147483] "m" Vector__XXX
 SG_ Yaw : 64|16@1- (0.0001,0) [-3.2768|3.2767] "rad" Vector__XXX
 SG_ Fix : 80|4@1+ (1,0) [0|15] "" Vector__XXX
 SG_ Counter : 84|4@1+ (1,0) [0|15] "" Vector__XXX
 SG_ Crc : 88|8@1+ (1,0) [0|255] "" Vector__XXX

BO_ 513 Satellites: 8 Vector__XXX
 SG_ Latitude : 0|32@1- (1e-07,0) [-90|90] "deg" Vector__XXX
 SG_ Longitude : 32|32@1- (1e-07,0) [-180|180] "deg" Vector__XXX

BO_ 514 Course: 2 Vector__XXX
 SG_ Heading : 0|16@1+ (0.01,0) [0|360] "deg" Vector__XXX
"""

METRES = """kind = "pose"
dbc = "pose.dbc"

[place]
message = "Place"
x = { signal = "X", unit = "m", valid = { signal = "Fix", one_of = [4, 5] } }
y = { signal = "Y", unit = "m" }
counter = "Counter"
crc = { signal = "Crc", algorithm = "crc8.sae_j1850" }

[heading]
yaw = { signal = "Yaw", unit = "rad" }
"""

# A heading is clockwise from the north: yaw = 90° - heading.
EARTH = """kind = "pose"
dbc = "pose.dbc"

[place]
message = "Satellites"
latitude = { signal = "Latitude", unit = "deg" }
longitude = { signal = "Longitude", unit = "deg" }
latency_ms = 30

[heading]
message = "Course"
yaw = { signal = "Heading", unit = "deg", sign = -1, offset = 1.5707963267948966 }
latency_ms = 10
"""

MESSAGES = cantools.database.load_string(DBC)


def write(folder: Path) -> Path:
    """The DBC and both profiles, metres.toml and earth.toml; the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("pose.dbc", DBC), ("metres.toml", METRES), ("earth.toml", EARTH)):
        (folder / name).write_text(text)
    return folder


def metres(x: float, y: float, yaw: float, counter: int, time: float, fix: int = 4) -> can.Message:
    values = {"X": x, "Y": y, "Yaw": yaw, "Fix": fix, "Counter": counter % 16, "Crc": 0}
    payload = MESSAGES.encode_message("Place", values)
    values["Crc"] = crc8(payload[:11] + payload[12:])
    return frame(0x200, MESSAGES.encode_message("Place", values), time, fd=True)


def satellites(latitude: float, longitude: float, time: float) -> can.Message:
    """Degrees."""
    return frame(0x201, MESSAGES.encode_message("Satellites", {"Latitude": latitude, "Longitude": longitude}), time)


def course(heading: float, time: float) -> can.Message:
    """Degrees, clockwise from the north."""
    return frame(0x202, MESSAGES.encode_message("Course", {"Heading": heading % 360.0}), time)
