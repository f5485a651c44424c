"""Sensor profiles: which signal of which DBC is which quantity, in what unit and sign, and how a cycle is put together.

A profile is a TOML file beside the DBC (dbc/README.md describes every key). The code knows no sensor by name. Signal names may
hold `{n}`, the number of the message, and `{k}`, the number of the detection in its frame, in Python's format syntax: `{n:02d}`.
"""

from __future__ import annotations

import difflib
import math
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from echogrid.config.toml import Table, load
from echogrid.errors import EchogridError
from echogrid.files import surely

# Factor from each unit to SI, by what it measures.
UNITS = {
    "length": {"m": 1.0, "cm": 0.01},
    "speed": {"m/s": 1.0, "km/h": 1 / 3.6},
    "angle": {"rad": 1.0, "deg": math.pi / 180},
    "turn rate": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "radar cross section": {"dBsm": 1.0},
    "share": {"1": 1.0, "%": 0.01},
}
DATABASES = (".dbc", ".arxml", ".kcd", ".sym")  # files of signals, which a profile is not
MESSAGES = 2048  # as many as there are ids of 11 bits
FACTORS = {unit: factor for units in UNITS.values() for unit, factor in units.items()}
Sign = Literal[1, -1]
Milliseconds = Annotated[float, Meta(ge=0, le=60_000)]


class Valid(Table, frozen=True):
    """Holds where the raw value of the signal is one of `one_of`, or none of `none_of`."""

    signal: str
    one_of: tuple[int, ...] = ()
    none_of: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if bool(self.one_of) == bool(self.none_of):
            raise ValueError(f"'{self.signal}' needs either one_of or none_of")


class Quantity(Table, frozen=True):
    """Physical value = sign * unit factor * the DBC's value + offset (SI); `negative_if` is a sign bit in a signal of its own."""

    signal: str
    unit: str
    sign: Sign = 1
    offset: Annotated[float, Meta(ge=-1e9, le=1e9)] = 0.0
    negative_if: Valid | None = None
    valid: Valid | None = None

    def __post_init__(self) -> None:
        if self.unit not in FACTORS:
            raise ValueError(f"'{self.unit}' is not a known unit, expected one of {', '.join(FACTORS)}")

    @property
    def factor(self) -> float:
        """From the DBC's value to SI, with the sign turned."""
        return self.sign * FACTORS[self.unit]


def _measures(dimension: str, **quantities: Quantity | None) -> None:
    """Raises ValueError where a quantity has a unit of something else."""
    for key, quantity in quantities.items():
        if quantity is not None and quantity.unit not in UNITS[dimension]:
            raise ValueError(f"{key} is a {dimension}, but '{quantity.unit}' is not; expected one of {', '.join(UNITS[dimension])}")


class FrameCrc(Table, frozen=True):
    """A checksum over the frame's other bytes; `algorithm` is one of fastcrc's, such as crc8.sae_j1850, or of `can.e2e`, with a data id."""

    signal: str
    algorithm: str
    data_id: int | tuple[int, ...] = ()

    @property
    def data_ids(self) -> tuple[int, ...]:
        """None, one, or one for each value of the counter."""
        return (self.data_id,) if isinstance(self.data_id, int) else self.data_id


class CycleCrc(Table, frozen=True):
    """A checksum over a whole cycle: the header without the checksum's own bytes, then the detection frames by slot.

    `message` is the header or a message of its own, which then ends the cycle and is not summed itself.
    """

    message: str
    signal: str
    algorithm: str


class Header(Table, frozen=True):
    message: str
    cycle: str | None = None
    count: tuple[str, ...] = ()  # summed: some sensors count near and far apart
    age: Quantity | None = None
    age_message: str | None = None  # where the age comes in another message of the cycle
    ambiguity: Quantity | None = None
    blockage: Quantity | None = None

    def __post_init__(self) -> None:
        _measures("time", age=self.age)
        _measures("speed", ambiguity=self.ambiguity)
        _measures("share", blockage=self.blockage)


class Detections(Table, frozen=True):
    messages: str
    n: tuple[int, int] | None = None  # first and last number of the message
    page: str | None = None
    cycle: str | None = None
    cycle_bits: Annotated[int, Meta(ge=1, le=64)] | None = None
    per_frame: Annotated[int, Meta(ge=1, le=64)] = 1
    first_k: Annotated[int, Meta(ge=0, le=1000)] = 1
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
        if self.n is not None and not 0 <= self.n[0] <= self.n[1] < MESSAGES:
            raise ValueError(f"n = {list(self.n)} found, expected the first and the last number, from 0 to {MESSAGES - 1}")
        for one, other in (("range and azimuth", "x and y"), ("range_rate", "vx and vy")):
            halves = [all(getattr(self, key) is not None for key in names.split(" and ")) for names in (one, other)]
            some = [any(getattr(self, key) is not None for key in names.split(" and ")) for names in (one, other)]
            if halves != some or sum(halves) != 1:
                raise ValueError(f"needs either {one}, or {other}")
        _measures("length", range=self.range, x=self.x, y=self.y)
        _measures("angle", azimuth=self.azimuth)
        _measures("speed", range_rate=self.range_rate, vx=self.vx, vy=self.vy)
        _measures("radar cross section", rcs=self.rcs)


class RadarProfile(Table, frozen=True, tag_field="kind", tag="radar"):
    """How one radar's traffic becomes scans.

    `ends_with`: the message that ends a cycle, for sensors whose header does not come first. `frames`: detection frames in every
    cycle, if the header's count does not say so. `latency_ms` replaces a measurement age that the sensor does not report.
    """

    detections: Detections
    header: Header | None = None
    crc: CycleCrc | None = None
    dbc: str | None = None
    ends_with: str | None = None
    frames: Annotated[int, Meta(ge=1, le=4096)] | None = None
    timeout_ms: Milliseconds = 100.0
    latency_ms: Milliseconds = 0.0
    ambiguity_interval: Annotated[float, Meta(ge=0, le=1000)] = 0.0  # m/s, for sensors that do not report theirs; 0: unambiguous
    max_detections: Annotated[int, Meta(ge=1, le=65536)] = 64

    def __post_init__(self) -> None:
        if self.header is None and (self.ends_with is None or self.frames is None):
            raise ValueError("without a [header], ends_with and frames must say where a cycle ends")
        if self.header is not None and not self.header.count and self.frames is None:
            raise ValueError("needs header.count or frames, to know when a cycle is complete")


class WheelSpeeds(Table, frozen=True):
    message: str
    rear_left: Quantity
    rear_right: Quantity
    latency_ms: Milliseconds = 0.0
    counter: str | None = None
    crc: FrameCrc | None = None

    def __post_init__(self) -> None:
        _measures("turn rate" if self.are_turn_rates else "speed", rear_left=self.rear_left, rear_right=self.rear_right)

    @property
    def are_turn_rates(self) -> bool:
        """Whether the tyre's radius is needed to make speeds of them."""
        return self.rear_left.unit in UNITS["turn rate"]


class YawRateFrame(Table, frozen=True):
    message: str
    yaw_rate: Quantity
    latency_ms: Milliseconds = 0.0
    counter: str | None = None
    crc: FrameCrc | None = None

    def __post_init__(self) -> None:
        _measures("turn rate", yaw_rate=self.yaw_rate)


class Direction(Table, frozen=True):
    """Raw values that mean reverse, and those that say nothing about the direction (the last one then holds)."""

    message: str
    signal: str
    reverse: tuple[int, ...]
    unknown: tuple[int, ...] = ()


class MotionProfile(Table, frozen=True, tag_field="kind", tag="motion"):
    """Where rear wheel speeds and yaw rate come from; without `direction` the car is taken to go forward."""

    wheel_speeds: WheelSpeeds
    yaw_rate: YawRateFrame
    direction: Direction | None = None
    dbc: str | None = None


class Place(Table, frozen=True):
    """Of a point of the car: `x` and `y` in a frame of metres, or `latitude` and `longitude`."""

    message: str
    x: Quantity | None = None
    y: Quantity | None = None
    latitude: Quantity | None = None
    longitude: Quantity | None = None
    latency_ms: Milliseconds = 0.0
    counter: str | None = None
    crc: FrameCrc | None = None

    def __post_init__(self) -> None:
        here = [self.x is not None, self.y is not None]
        on_earth = [self.latitude is not None, self.longitude is not None]
        if here != [not there for there in on_earth] or here[0] != here[1]:
            raise ValueError("needs either x and y, or latitude and longitude")
        _measures("length", x=self.x, y=self.y)
        _measures("angle", latitude=self.latitude, longitude=self.longitude)

    @property
    def is_on_earth(self) -> bool:
        """Whether an origin is needed to make metres of it."""
        return self.latitude is not None

    @property
    def quantities(self) -> dict[str, Quantity]:
        """The two, in this order."""
        both = {"latitude": self.latitude, "longitude": self.longitude} if self.is_on_earth else {"x": self.x, "y": self.y}
        return {name: quantity for name, quantity in both.items() if quantity is not None}


class Heading(Table, frozen=True):
    """Counter-clockwise from the frame's x axis; from the east where the place is latitude and longitude. `message`: if not the place's."""

    yaw: Quantity
    message: str | None = None
    latency_ms: Milliseconds = 0.0
    counter: str | None = None
    crc: FrameCrc | None = None

    def __post_init__(self) -> None:
        _measures("angle", yaw=self.yaw)
        if self.message is None and (self.latency_ms or self.counter or self.crc):
            raise ValueError("latency_ms, counter or crc found, expected with a message of its own: the place's are those of both")


class PoseProfile(Table, frozen=True, tag_field="kind", tag="pose"):
    """Where a pose from outside comes from."""

    place: Place
    heading: Heading
    dbc: str | None = None

    def __post_init__(self) -> None:
        if self.heading.message == self.place.message:
            raise ValueError(f"heading.message is the place's, '{self.place.message}'; expected none, or another")


def shipped() -> Path:
    """The folder of the DBC files and profiles that come with echogrid."""
    return Path(str(files("echogrid") / "dbc"))


def find(name: str, beside: Path) -> Path:
    """A profile's file: the name of a shipped one, or a path ending in .toml from the folder `beside`. Raises EchogridError."""
    if name.endswith(".toml"):
        return beside / name
    if name.lower().endswith(DATABASES):
        said = f"'{name}' found, which belongs under the key 'dbc': expected a profile that says what its signals are"
        raise EchogridError(f"profile: {said}; `echogrid init` writes one")
    path = shipped() / f"{name}.toml"
    if not surely(path.is_file):
        known = sorted(entry.stem for entry in shipped().glob("*.toml"))
        own = [f"{name}.toml"] if surely((beside / f"{name}.toml").is_file) else difflib.get_close_matches(name, known, n=1)
        guess = f"; did you mean '{own[0]}'?" if own else ""
        raise EchogridError(f"no profile '{name}' is shipped, expected one of {', '.join(known)}, or a path that ends in .toml{guess}")
    return path


def load_radar(path: Path) -> RadarProfile:
    """Raises EchogridError."""
    return load(path, RadarProfile)


def load_motion(path: Path) -> MotionProfile:
    """Raises EchogridError."""
    return load(path, MotionProfile)


def load_pose(path: Path) -> PoseProfile:
    """Raises EchogridError."""
    return load(path, PoseProfile)
