"""From findings to the lines of the configuration, or of a profile, that mend them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from echogrid.can.profile import FACTORS, UNITS, MotionProfile, PoseProfile, Quantity, RadarProfile
from echogrid.config.editing import Path, literal
from echogrid.config.tables import Config
from echogrid.judging.finding import Finding
from echogrid.judging.traffic import Moved
from echogrid.judging.weighing import NEAR

IDENTITY = ("bus", "profile", "dbc", "id_offset", "latency_ms")  # of whose traffic it is, not where it sits
MOTION, POSE = "motion", "pose"  # whose profile is changed, where it is no radar's
RIGHT = 5.0  # deg: an angle that is so near to a right one is one
ROUND_FOV = 5.0  # deg


@dataclass(slots=True)
class Fix:
    """`config`: new values by path. `profiles`: new values by whose profile, a radar's name, MOTION or POSE. `says`: what has no line."""

    config: dict[Path, Any] = field(default_factory=dict)
    profiles: dict[str, dict[Path, Any]] = field(default_factory=dict)
    says: str = ""

    def lines(self, config: Config) -> list[str]:
        """For people: where, and what to write there."""
        said = []
        for path, value in self.config.items():
            table = f"[[{path[0]}]]" if len(path) > 2 else f"[{path[0]}]"
            named: Sequence[Any] = getattr(config, str(path[0])) if len(path) > 2 else ()
            name = f" {named[int(path[1])].name}" if named else ""
            said.append(f"{table}{name}: {path[-1]} = {literal(value)}")
        for owner, changes in self.profiles.items():
            for path, value in changes.items():
                said.append(f"profile of {owner}: [{path[0]}] {path[1]}: {path[2]} = {literal(value)}")
        return [*said, *([self.says] if self.says else [])]


@dataclass(frozen=True, slots=True)
class Mender:
    """What a fix needs to know: the configuration, its profiles, and where frames were found that are not where they should be."""

    config: Config
    radars: Mapping[str, RadarProfile]
    motion: MotionProfile
    moved: Mapping[str, Moved]
    channels: Mapping[str, Sequence[str]]  # of the recording, by bus
    pose: PoseProfile | None = None

    def fix(self, finding: Finding) -> Fix:
        """The lines that would mend one finding; `says` alone where no line would."""
        make: Callable[[Finding], Fix] | None = getattr(self, f"_{finding.code}", None)
        return Fix(says=SAYS.get(finding.code, "")) if make is None else make(finding)

    def _index(self, name: str) -> int:
        return [radar.name for radar in self.config.radar].index(name)

    def _wrong_channel(self, finding: Finding) -> Fix:
        owners = [name for name, bus in self._buses().items() if bus == finding.subject]
        channel = next(self.moved[name].channel for name in owners if name in self.moved)
        index = [bus.name for bus in self.config.bus].index(finding.subject)
        return Fix({("bus", index, "log_channel"): int(channel) if channel.isdecimal() else channel})

    def _buses(self) -> dict[str, str]:
        return {radar.name: radar.bus for radar in self.config.radar} | {
            "speed": self.config.motion.bus,
            "yaw rate": self.config.motion.bus,
            **({} if self.config.pose is None or self.config.pose.bus is None else {"pose": self.config.pose.bus}),
        }

    def _wrong_bus(self, finding: Finding) -> Fix:
        name = finding.radars[0] if finding.radars else finding.subject
        channel = self.moved[name].channel
        bus = next((bus for bus, names in self.channels.items() if channel in names), None)
        if bus is None:
            return Fix(says=f"add a [[bus]] with log_channel = {literal(channel)}, and give it as the bus of {name}")
        table = ("radar", self._index(name)) if finding.radars else ("pose",) if name == "pose" else ("motion",)
        return Fix({(*table, "bus"): bus})

    def _wrong_id_offset(self, finding: Finding) -> Fix:
        index = self._index(finding.radars[0])
        fix = Fix({("radar", index, "id_offset"): self.config.radar[index].id_offset + round(finding.value)})
        bus = next((bus for bus, names in self.channels.items() if self.moved[finding.radars[0]].channel in names), None)
        if bus not in (None, self.config.radar[index].bus):
            fix.config["radar", index, "bus"] = bus
        return fix

    def _pose_missing(self, finding: Finding) -> Fix:
        return Fix(says="take [pose] out of the configuration, or connect its sender")

    def _pose_heading_offset(self, finding: Finding) -> Fix:
        old = 0.0 if self.config.pose is None else self.config.pose.yaw_deg
        return Fix({("pose", "yaw_deg"): round(math.remainder(old - _right(finding.value), 360.0), 1)})

    def _pose_heading_sign(self, finding: Finding) -> Fix:
        """The car's yaw is value - (sign x signal + offset - yaw_deg), and shall be -sign x signal + another offset - yaw_deg."""
        if self.pose is None or self.config.pose is None:
            return Fix(says=SAYS["pose_heading_sign"])
        own = self.pose.heading.yaw
        turn = _right(finding.value) - math.degrees(own.offset) + 2.0 * self.config.pose.yaw_deg
        offset = round(math.radians(math.remainder(turn, 360.0)), 6)
        return Fix(profiles={POSE: {("heading", "yaw", "sign"): -own.sign, ("heading", "yaw", "offset"): offset}})

    def _pose_heading_unit(self, finding: Finding) -> Fix:
        if self.pose is None:
            return Fix(says=SAYS["pose_heading_unit"])
        own = self.pose.heading.yaw
        changes: dict[Path, Any] = {("heading", "yaw", "unit"): _unit(own, abs(finding.value))}
        if finding.value < 0.0:
            changes["heading", "yaw", "sign"] = -own.sign
        return Fix(profiles={POSE: changes})

    def _radar_missing(self, finding: Finding) -> Fix:
        return Fix(says=f"take the [[radar]] {finding.radars[0]} out of the configuration, or connect it")

    def _speed_sign(self, finding: Finding) -> Fix:
        return self._motion_signs("wheel_speeds", "rear_left", "rear_right")

    def _yaw_rate_sign(self, finding: Finding) -> Fix:
        return self._motion_signs("yaw_rate", "yaw_rate")

    def _motion_signs(self, table: str, *names: str) -> Fix:
        of = getattr(self.motion, table)
        return Fix(profiles={MOTION: {(table, name, "sign"): -getattr(of, name).sign for name in names}})

    def _speed_unit(self, finding: Finding) -> Fix:
        wheels = self.motion.wheel_speeds
        unit = _unit(wheels.rear_left, finding.value)
        if unit is None:
            return self._wheel_scale(finding)
        return Fix(profiles={MOTION: {("wheel_speeds", name, "unit"): unit for name in ("rear_left", "rear_right")}})

    def _speed_scale(self, finding: Finding) -> Fix:
        return self._wheel_scale(finding)

    def _wheel_scale(self, finding: Finding) -> Fix:
        motion = self.config.motion
        if motion.wheel_radius is not None:
            return Fix({("motion", "wheel_radius"): round(motion.wheel_radius * finding.value, 4)})
        return Fix({("motion", "wheel_scale"): round(motion.wheel_scale * finding.value, 4)})

    def _wheels_swapped(self, finding: Finding) -> Fix:
        wheels = self.motion.wheel_speeds
        left, right = wheels.rear_left.signal, wheels.rear_right.signal
        return Fix(profiles={MOTION: {("wheel_speeds", "rear_left", "signal"): right, ("wheel_speeds", "rear_right", "signal"): left}})

    def _yaw_rate_unit(self, finding: Finding) -> Fix:
        unit = _unit(self.motion.yaw_rate.yaw_rate, finding.value)
        return Fix(says=SAYS["scale"]) if unit is None else Fix(profiles={MOTION: {("yaw_rate", "yaw_rate", "unit"): unit}})

    def _yaw_rate_bias(self, finding: Finding) -> Fix:
        return Fix({("motion", "yaw_rate_bias_deg_s"): round(self.config.motion.yaw_rate_bias_deg_s + finding.value, 3)})

    def _azimuth_sign(self, finding: Finding) -> Fix:
        return self._signs(finding, ("azimuth", "y", "vy"))

    def _range_rate_sign(self, finding: Finding) -> Fix:
        return self._signs(finding, ("range_rate", "vx", "vy"))

    def _signs(self, finding: Finding, names: Sequence[str]) -> Fix:
        return Fix(
            profiles={
                name: {("detections", key, "sign"): -quantity.sign for key, quantity in self._quantities(name, names)}
                for name in finding.radars
            }
        )

    def _azimuth_unit(self, finding: Finding) -> Fix:
        return self._units(finding, ("azimuth",))

    def _range_unit(self, finding: Finding) -> Fix:
        return self._units(finding, ("range", "x", "y"))

    def _range_rate_unit(self, finding: Finding) -> Fix:
        return self._units(finding, ("range_rate", "vx", "vy"))

    def _units(self, finding: Finding, names: Sequence[str]) -> Fix:
        (radar,) = finding.radars
        units: dict[Path, str | None] = {
            ("detections", key, "unit"): _unit(quantity, finding.value) for key, quantity in self._quantities(radar, names)
        }
        return Fix(says=SAYS["scale"]) if None in units.values() else Fix(profiles={radar: {**units}})

    def _quantities(self, radar: str, names: Sequence[str]) -> list[tuple[str, Quantity]]:
        found = [(key, getattr(self.radars[radar].detections, key)) for key in names]
        return [(key, quantity) for key, quantity in found if quantity is not None]

    def _radars_swapped(self, finding: Finding) -> Fix:
        return self._swapped(finding)

    def _front_rear_swapped(self, finding: Finding) -> Fix:
        return self._swapped(finding)

    def _left_right_swapped(self, finding: Finding) -> Fix:
        return self._swapped(finding)

    def _swapped(self, finding: Finding) -> Fix:
        """`finding.radars` two by two: each has the other's traffic."""
        if len(finding.radars) % 2:
            return Fix(says="put x, y and yaw_deg of these radars in the order that the sentence says")
        fix = Fix()
        for a, b in zip(finding.radars[::2], finding.radars[1::2], strict=True):
            one, other = (self.config.radar[self._index(name)] for name in (a, b))
            for key in IDENTITY:
                if getattr(one, key) != getattr(other, key):
                    fix.config["radar", self._index(a), key] = getattr(other, key)
                    fix.config["radar", self._index(b), key] = getattr(one, key)
        return fix

    def _mount_yaw(self, finding: Finding) -> Fix:
        return Fix({("radar", self._index(finding.radars[0]), "yaw_deg"): round(finding.value, 1)})

    def _mount_x(self, finding: Finding) -> Fix:
        return Fix({("radar", self._index(finding.radars[0]), "x"): round(finding.value, 1)})

    def _mount_y(self, finding: Finding) -> Fix:
        return Fix({("radar", self._index(finding.radars[0]), "y"): round(finding.value, 1)})

    def _mount_y_sign(self, finding: Finding) -> Fix:
        return Fix({("radar", n, "y"): -radar.y for n, radar in enumerate(self.config.radar)})

    def _mount_yaw_sign(self, finding: Finding) -> Fix:
        return Fix({("radar", n, "yaw_deg"): -radar.yaw_deg for n, radar in enumerate(self.config.radar)})

    def _mount_yaw_unit(self, finding: Finding) -> Fix:
        return Fix({("radar", n, "yaw_deg"): round(math.degrees(radar.yaw_deg), 1) for n, radar in enumerate(self.config.radar)})

    def _time_offset(self, finding: Finding) -> Fix:
        if not finding.radars:
            return Fix({("motion", "latency_ms"): round(self.config.motion.latency_ms + finding.value, 1)})
        return Fix(
            {
                ("radar", n, "latency_ms"): round(radar.latency_ms + finding.value, 1)
                for n, radar in enumerate(self.config.radar)
                if radar.name in finding.radars
            }
        )

    def _field_of_view(self, finding: Finding) -> Fix:
        degrees = min(math.ceil(finding.value / ROUND_FOV) * ROUND_FOV, 360.0)
        return Fix({("radar", self._index(finding.radars[0]), "fov_deg"): degrees})


SAYS = {
    "scale": "no unit has this factor: the DBC's scale of the signal is another than the sensor's; take the DBC of its version",
    "yaw_rate_scale": "the DBC's scale of the yaw rate is another than the sensor's; take the DBC of its version",
    "azimuth_scale": "the DBC's scale of the azimuths is another than the sensor's; take the DBC of its version",
    "range_scale": "the DBC's scale of the ranges is another than the sensor's; take the DBC of its version",
    "range_rate_scale": "the DBC's scale of the range rates is another than the sensor's; take the DBC of its version",
    "byte_order": "in the DBC: @0 (Motorola) and @1 (Intel) after the signal's bits, and its start bit",
    "checksum": "in the profile: the algorithm of crc, or the DBC",
    "no_channels": "record in a format that has channels (docs/recordings.md), or one bus a file",
    "wrong_length": "the DBC is another version's",
    "pose_swapped": "in the pose's profile: the signals of latitude and longitude change places",
    "pose_mirrored": "in the pose's profile: the signals of x and y, or of latitude and longitude, change places, or one gets another sign",
    "pose_heading_sign": "the sender's yaw is counter-clockwise from x",
    "pose_heading_unit": "the sender's yaw is in radians",
    "blocked": "clean the radar, look what is before it, and whether it is on",
    "blocked_sector": "look what is before the radar",
    "lost_frames": "look at the bus load, and at what records it",
}


def _right(degrees: float) -> float:
    """A right angle, if it is nearly one."""
    nearest = 90.0 * round(degrees / 90.0)
    return nearest if abs(degrees - nearest) < RIGHT else degrees


def _unit(quantity: Quantity, factor: float) -> str | None:
    """The unit that is `factor` times the quantity's own one, or None."""
    units = next(units for units in UNITS.values() if quantity.unit in units)
    wanted = FACTORS[quantity.unit] * factor
    return next((unit for unit, value in units.items() if abs(value / wanted - 1) < NEAR), None)
