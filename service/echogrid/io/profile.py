"""Sensor profiles: which signal of which DBC is which quantity, in what unit and sign, and how a cycle is put together.

A profile is a TOML file beside the DBC (dbc/README.md describes every key). No sensor is known to the code by name. Signal names may
hold `{n}`, the number of the message, and `{k}`, the number of the detection in its frame, in Python's format syntax: `{n:02d}`.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from echogrid.errors import EchogridError
from echogrid.io.toml import Table, load

# Factor from the unit to SI. Wheel turn rates need the tyre's radius as well.
UNITS = {
    "m": 1.0,
    "cm": 0.01,
    "m/s": 1.0,
    "km/h": 1 / 3.6,
    "rad": 1.0,
    "deg": 0.017453292519943295,
    "rad/s": 1.0,
    "deg/s": 0.017453292519943295,
    "rpm": 0.10471975511965977,
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "dBsm": 1.0,
    "%": 0.01,
    "1": 1.0,
}
Unit = Literal["m", "cm", "m/s", "km/h", "rad", "deg", "rad/s", "deg/s", "rpm", "s", "ms", "us", "dBsm", "%", "1"]
Sign = Literal[1, -1]


class Valid(Table):
    """Holds where the raw value of the signal is one of `one_of`, or none of `none_of`."""

    signal: str
    one_of: tuple[int, ...] = ()
    none_of: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if bool(self.one_of) == bool(self.none_of):
            raise ValueError(f"'{self.signal}' needs either one_of or none_of")


class Quantity(Table):
    """Physical value = sign * unit factor * the DBC's value + offset (SI); `negative_if` is a sign bit in a signal of its own."""

    signal: str
    unit: Unit
    sign: Sign = 1
    offset: float = 0.0
    negative_if: Valid | None = None
    valid: Valid | None = None


class FrameCrc(Table):
    """A checksum over the frame's other bytes; `algorithm` is one of fastcrc's, such as crc8.sae_j1850."""

    signal: str
    algorithm: str


class CycleCrc(Table):
    """A checksum over a whole cycle: the header without the checksum's own bytes, then the detection frames by slot.

    `message` is the header or a message of its own, which then ends the cycle and is not summed itself.
    """

    message: str
    signal: str
    algorithm: str


class Header(Table):
    message: str
    cycle: str | None = None
    count: tuple[str, ...] = ()  # summed: some sensors count near and far apart
    age: Quantity | None = None
    ambiguity: Quantity | None = None
    blockage: Quantity | None = None


class Detections(Table):
    messages: str
    n: tuple[int, int] | None = None  # first and last number of the message
    page: str | None = None
    first_page: int = 0
    cycle: str | None = None
    cycle_bits: int | None = None
    per_frame: Annotated[int, Meta(ge=1)] = 1
    first_k: int = 1
    range: Quantity | None = None
    azimuth: Quantity | None = None
    range_rate: Quantity | None = None
    x: Quantity | None = None
    y: Quantity | None = None
    vx: Quantity | None = None
    vy: Quantity | None = None
    rcs: Quantity | None = None
    valid: Valid | None = None
    crc: FrameCrc | None = None

    def __post_init__(self) -> None:
        polar = (self.range, self.azimuth, self.range_rate)
        cartesian = (self.x, self.y, self.vx, self.vy)
        if not (all(polar) and not any(cartesian)) and not (all(cartesian) and not any(polar)):
            raise ValueError("needs range, azimuth and range_rate, or x, y, vx and vy, and not both")


class RadarProfile(Table, tag_field="kind", tag="radar"):
    """How one radar's traffic becomes scans.

    `ends_with`: the message that ends a cycle, for sensors whose header does not come first. `frames`: detection frames in every
    cycle, where the header's count does not say so. `latency_ms` stands in for a measurement age that the sensor does not report.
    """

    detections: Detections
    header: Header | None = None
    crc: CycleCrc | None = None
    dbc: str | None = None
    ends_with: str | None = None
    frames: int | None = None
    timeout_ms: float = 100.0
    latency_ms: float = 0.0
    max_detections: Annotated[int, Meta(ge=1)] = 64

    def __post_init__(self) -> None:
        if self.header is None and (self.ends_with is None or self.frames is None):
            raise ValueError("without a [header], ends_with and frames must say where a cycle ends")
        if self.header is not None and not self.header.count and self.frames is None:
            raise ValueError("needs header.count or frames, to know when a cycle is whole")


class WheelSpeeds(Table):
    message: str
    rear_left: Quantity
    rear_right: Quantity
    latency_ms: float = 0.0
    counter: str | None = None
    crc: FrameCrc | None = None


class YawRateFrame(Table):
    message: str
    yaw_rate: Quantity
    latency_ms: float = 0.0
    counter: str | None = None
    crc: FrameCrc | None = None


class Direction(Table):
    """Raw values that mean reverse, and those that say nothing about the direction (the last one then holds)."""

    message: str
    signal: str
    reverse: tuple[int, ...]
    unknown: tuple[int, ...] = ()


class MotionProfile(Table, tag_field="kind", tag="motion"):
    """Where rear wheel speeds and yaw rate come from; without `direction` the car is taken to go forward."""

    wheel_speeds: WheelSpeeds
    yaw_rate: YawRateFrame
    direction: Direction | None = None
    dbc: str | None = None


def shipped() -> Path:
    """The folder of the DBC files and profiles that come with echogrid."""
    return Path(str(files("echogrid") / "dbc"))


def find(name: str, beside: Path) -> Path:
    """A profile's file: the name of a shipped one, or a path ending in .toml, from the folder of the configuration."""
    if name.endswith(".toml"):
        return beside / name
    path = shipped() / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(entry.stem for entry in shipped().glob("*.toml")))
        raise EchogridError(f"no profile '{name}' is shipped; found {known}, or give a path that ends in .toml")
    return path


def load_radar(path: Path) -> RadarProfile:
    """Raises EchogridError."""
    return load(path, RadarProfile)


def load_motion(path: Path) -> MotionProfile:
    """Raises EchogridError."""
    return load(path, MotionProfile)
