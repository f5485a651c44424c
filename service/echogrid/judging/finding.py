"""What a check says: mistakes that were found, and what the drive did not allow to find."""

from __future__ import annotations

import math
from dataclasses import dataclass

CODES = {
    "motion_missing": "no frame of wheel speeds or yaw rate was decoded",
    "pose_missing": "no frame of the pose from outside was heard",
    "pose_swapped": "latitude and longitude of the pose from outside have each other's place",
    "pose_mirrored": "the places of the pose from outside go the other way round than the car",
    "pose_heading_sign": "the heading of the pose from outside has the wrong sign",
    "pose_heading_unit": "the heading of the pose from outside is off by a unit's factor",
    "pose_heading_offset": "the heading of the pose from outside is off by an angle",
    "radar_missing": "no frame of the radar was heard",
    "no_channels": "the recording does not say which bus a frame is of",
    "wrong_channel": "the bus's frames are on another channel of the recording",
    "wrong_bus": "the frames are on another of the configured buses",
    "wrong_id_offset": "the radar's frames have other ids",
    "wrong_length": "the frames are shorter than the DBC says",
    "checksum": "most checksums are wrong",
    "lost_frames": "frames or whole scans are missing",
    "silence": "ego motion or a radar is silent for more than half a second",
    "byte_order": "the values leap as no measurement does",
    "speed_sign": "the speed has the wrong sign",
    "speed_unit": "the speed is off by a unit's factor",
    "speed_scale": "the speed is off by a factor of no unit, as of another DBC version",
    "wheel_scale": "the speed is off by a few percent",
    "wheels_swapped": "the rear wheels have each other's signal",
    "yaw_rate_sign": "the yaw rate has the wrong sign",
    "yaw_rate_unit": "the yaw rate is off by a unit's factor",
    "yaw_rate_scale": "the yaw rate is off by a factor of no unit, as of another DBC version",
    "yaw_rate_bias": "the yaw rate is not 0 while the car goes straight or stands",
    "azimuth_sign": "azimuths, or y, have the wrong sign",
    "azimuth_unit": "azimuths are off by a unit's factor",
    "azimuth_scale": "azimuths are off by another factor, as of another DBC version",
    "range_unit": "ranges are off by a unit's factor",
    "range_scale": "ranges are off by another factor, as of another DBC version",
    "range_rate_sign": "range rates have the wrong sign",
    "range_rate_unit": "range rates are off by a unit's factor",
    "range_rate_scale": "range rates are off by another factor, as of another DBC version",
    "radars_swapped": "two radars have each other's place",
    "front_rear_swapped": "the front radars are at the rear, and the other way round",
    "left_right_swapped": "the left radars are on the right, and the other way round",
    "mount_yaw": "a radar's yaw is off",
    "mount_x": "a radar's x is off",
    "mount_y": "a radar's y is off",
    "mount_y_sign": "all y are positive to the right",
    "mount_yaw_sign": "all yaws are given clockwise",
    "mount_yaw_unit": "all yaws are given in radians",
    "time_offset": "a radar's scans and ego motion are of different times",
    "blocked": "a radar sees next to nothing",
    "blocked_sector": "a radar sees nothing in a part of its field of view",
    "field_of_view": "detections lie outside the configured field of view",
    "unexplained": "no mistake that is known explains a radar's range rates",
}
MOST_CONFIDENT = 0.999


@dataclass(frozen=True, slots=True)
class Finding:
    """`code`: a key of CODES. `radars`: those concerned; none for what concerns ego motion or a bus. `value`: the number of it, in `unit`.

    `sentence` is for a person. `rests_on`: what was looked at. `subject`: a bus's name, "speed", "yaw rate" or "pose", if no radar.
    """

    code: str
    sentence: str
    value: float
    unit: str
    confidence: float
    rests_on: str
    radars: tuple[str, ...] = ()
    subject: str = ""


@dataclass(frozen=True, slots=True)
class Undecided:
    """What could not be judged, and which manoeuvre would allow it."""

    code: str
    sentence: str


def surely(value: float, sigma: float, limit: float = 0.0) -> float:
    """How sure it is, 0 … 1, that a value with this sigma is farther from 0 than a limit."""
    return min(0.5 * (1 + math.erf((abs(value) - limit) / (sigma * math.sqrt(2)))), MOST_CONFIDENT)
