"""Classic mistakes of a first configuration, planted into a sound drive, each with the code and the lines that a check must come to."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import can
import numpy as np

from tests.faults.drive import Frame, cycle_with, cycles_of
from tests.support.places import DBC

NAMES = ("front_left", "front_right", "rear_left", "rear_right")
FRONT_RIGHT = 1
Change = Callable[["Planted"], "Planted"]


@dataclass(frozen=True)
class Planted:
    """A drive and what is configured for it: the configuration's text, other files beside it, and the messages."""

    config: str
    messages: list[can.Message]
    files: Mapping[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> Path:
        """The configuration's file."""
        for name, text in self.files.items():
            (folder / name).write_text(text)
        path = folder / "echogrid.toml"
        path.write_text(self.config)
        return path

    def sub(self, pattern: str, to: str, count: int = 1) -> Planted:
        changed, found = re.subn(pattern, to, self.config, count=count)
        assert found, pattern
        return replace(self, config=changed)

    def radar(self, number: int, **values: float | str) -> Planted:
        """With other values of one [[radar]]."""
        parts = self.config.split("[[radar]]")
        for key, value in values.items():
            told = f'"{value}"' if isinstance(value, str) else repr(value)
            changed, found = re.subn(rf"(?m)^{key} = .*$", f"{key} = {told}", parts[number + 1])
            parts[number + 1] = changed if found else parts[number + 1].rstrip() + f"\n{key} = {told}\n\n"
        return replace(self, config="[[radar]]".join(parts))

    def value(self, number: int, key: str) -> float:
        found = re.search(rf"(?m)^{key} = (\S+)", self.config.split("[[radar]]")[number + 1])
        assert found
        return float(int(found[1], 0)) if found[1].startswith("0x") else float(found[1])

    def motion_profile(self, pattern: str, to: str) -> Planted:
        """With an own copy of the motion's profile, changed."""
        text, found = re.subn(pattern, to, self._file("vehicle_motion.toml"))
        assert found, pattern
        files = {**self.files, "own_motion.toml": text, "vehicle_motion.dbc": self._file("vehicle_motion.dbc")}
        config = re.sub(
            r'\[motion\]\nbus = "can0"\n(profile = .*\n)?', '[motion]\nbus = "can0"\nprofile = "own_motion.toml"\n', self.config
        )
        return replace(self, files=files, config=config)

    def motion_dbc(self, pattern: str, to: str) -> Planted:
        text, found = re.subn(pattern, to, self._file("vehicle_motion.dbc"))
        assert found, pattern
        return replace(self, files={**self.files, "vehicle_motion.dbc": text}).motion_profile("kind", "kind")

    def radar_profile(self, pattern: str, to: str, numbers: tuple[int, ...] = (0, 1, 2, 3), dbc: tuple[str, str] | None = None) -> Planted:
        """With an own copy of the radars' profile, and of its DBC, changed, for some of the radars."""
        text, found = re.subn(pattern, to, self._file("corner_radar.toml"))
        assert found, pattern
        layout = self._file("corner_radar.dbc")
        if dbc is not None:
            layout, found = re.subn(*dbc, layout)
            assert found, dbc
        planted = replace(self, files={**self.files, "own_radar.toml": text, "corner_radar.dbc": layout})
        for number in numbers:
            planted = planted.radar(number, profile="own_radar.toml")
        return planted

    def _file(self, name: str) -> str:
        return self.files[name] if name in self.files else (DBC / name).read_text()


@dataclass(frozen=True)
class Mistake:
    """`config` and `profiles`: what a right fix changes, by path; numbers within `within`. `says`: where no line can mend it."""

    name: str
    plant: Change
    code: str
    radars: tuple[str, ...] = ()
    config: Mapping[tuple[str | int, ...], Any] = field(default_factory=dict)
    profile: Mapping[tuple[str, ...], Any] = field(default_factory=dict)
    within: float = 0.0
    says: bool = False


def frames(planted: Planted) -> tuple[Frame, ...]:
    return tuple(Frame(message.timestamp, message) for message in planted.messages)


def cycles(planted: Planted, number: int, change: Callable[[list[Frame]], list[Frame]]) -> Planted:
    """With one radar's cycles changed."""
    every = frames(planted)
    changed = [frame for cycle in cycles_of(every, number) for frame in change(cycle)]
    rest = [frame for frame in every if frame.radar != number]
    return replace(planted, messages=[frame.message for frame in sorted((*rest, *changed), key=lambda frame: frame.message.timestamp)])


def swapped(one: int, other: int) -> Change:
    def change(planted: Planted) -> Planted:
        a, b = (int(planted.value(n, "id_offset")) for n in (one, other))
        return planted.radar(one, id_offset=b).radar(other, id_offset=a)

    return change


def both(first: Change, second: Change) -> Change:
    return lambda planted: second(first(planted))


def yaw_off(number: int, degrees: float) -> Change:
    return lambda planted: planted.radar(number, yaw_deg=planted.value(number, "yaw_deg") + degrees)


def yaws(change: Callable[[float], float]) -> Change:
    def all_of(planted: Planted) -> Planted:
        for number in range(4):
            planted = planted.radar(number, yaw_deg=change(planted.value(number, "yaw_deg")))
        return planted

    return all_of


def y_mirrored(*numbers: int) -> Change:
    def change(planted: Planted) -> Planted:
        for number in numbers:
            planted = planted.radar(number, y=-planted.value(number, "y"))
        return planted

    return change


def later(numbers: tuple[int, ...], seconds: float) -> Change:
    def change(planted: Planted) -> Planted:
        moved = [frame.later(seconds) if frame.radar in numbers else frame for frame in frames(planted)]
        return replace(planted, messages=[frame.message for frame in sorted(moved, key=lambda frame: frame.message.timestamp)])

    return change


def dropped(number: int, share: float) -> Change:
    random = np.random.default_rng(1)

    def change(planted: Planted) -> Planted:
        kept = [frame.message for frame in frames(planted) if frame.radar != number or random.random() > share]
        return replace(planted, messages=kept)

    return change


def blind_between(number: int, low: float, high: float) -> Change:
    """Detections in a sector (deg) are not valid."""

    def hide(values: dict[str, Any]) -> dict[str, Any]:
        inside = [k for k in range(1, 9) if low <= math.degrees(values[f"Azimuth_{k}"]) <= high]
        return {**values, **{f"Valid_{k}": 0 for k in inside}}

    return lambda planted: cycles(planted, number, lambda cycle: cycle_with(cycle, change=hide))


def nearly_blind(number: int) -> Change:
    return lambda planted: cycles(planted, number, lambda cycle: cycle_with(cycle, {"DetectionCount": 1}))


def on_another_bus(planted: Planted) -> Planted:
    bus = '[[bus]]\nname = "second"\nchannel = "can1"\n\n'
    return replace(planted, config=planted.config.replace("[motion]", bus + "[motion]", 1)).radar(FRONT_RIGHT, bus="second")


def without(number: int) -> Change:
    return lambda planted: replace(planted, messages=[frame.message for frame in frames(planted) if frame.radar != number])


RL, RR = r"(SG_ WheelSpeedR[LR] : .*?)\((\S+?),", r"\1({},"
PLANTED = (
    Mistake(
        "azimuth's sign",
        lambda p: p.radar_profile(r'(azimuth = \{.*?unit = "rad")', r"\1, sign = -1"),
        "azimuth_sign",
        NAMES,
        profile={("detections", "azimuth", "sign"): 1},
    ),
    Mistake(
        "one radar's azimuth's sign, in its own profile",
        lambda p: p.radar_profile(r'(azimuth = \{.*?unit = "rad")', r"\1, sign = -1", (FRONT_RIGHT,)),
        "azimuth_sign",
        (NAMES[FRONT_RIGHT],),
        profile={("detections", "azimuth", "sign"): 1},
    ),
    Mistake(
        "range rate's sign",
        lambda p: p.radar_profile(r'(range_rate = \{.*?unit = "m/s")', r"\1, sign = -1"),
        "range_rate_sign",
        NAMES,
        profile={("detections", "range_rate", "sign"): 1},
    ),
    Mistake(
        "azimuth's unit",
        lambda p: p.radar_profile(r'(azimuth = \{.*?unit = )"rad"', r'\1"deg"'),
        "azimuth_unit",
        NAMES,
        profile={("detections", "azimuth", "unit"): "rad"},
    ),
    Mistake(
        "range's unit",
        lambda p: p.radar_profile(r'(range = \{.*?unit = )"m"', r'\1"cm"'),
        "range_unit",
        NAMES,
        profile={("detections", "range", "unit"): "m"},
    ),
    Mistake(
        "range rate's unit",
        lambda p: p.radar_profile(r'(range_rate = \{.*?unit = )"m/s"', r'\1"km/h"'),
        "range_rate_unit",
        NAMES,
        profile={("detections", "range_rate", "unit"): "m/s"},
    ),
    Mistake(
        "range's scale in the DBC",
        lambda p: p.radar_profile("kind", "kind", dbc=(r"(SG_ Range_\d .*?)\(0.015625,", r"\1(0.03125,")),
        "range_scale",
        NAMES,
        says=True,
    ),
    Mistake(
        "front radars swapped",
        swapped(0, 1),
        "radars_swapped",
        NAMES[:2],
        {("radar", 0, "id_offset"): 0, ("radar", 1, "id_offset"): 16},
    ),
    Mistake(
        "left radars swapped",
        swapped(0, 2),
        "radars_swapped",
        (NAMES[0], NAMES[2]),
        {("radar", 0, "id_offset"): 0, ("radar", 2, "id_offset"): 32},
    ),
    Mistake(
        "radars swapped across",
        swapped(1, 2),
        "radars_swapped",
        NAMES[1:3],
        {("radar", 1, "id_offset"): 16, ("radar", 2, "id_offset"): 32},
    ),
    Mistake(
        "front and rear swapped",
        both(swapped(0, 2), swapped(1, 3)),
        "front_rear_swapped",
        NAMES,
        {("radar", n, "id_offset"): 16 * n for n in range(4)},
    ),
    Mistake(
        "left and right swapped",
        both(swapped(0, 1), swapped(2, 3)),
        "left_right_swapped",
        NAMES,
        {("radar", n, "id_offset"): 16 * n for n in range(4)},
    ),
    *(
        Mistake(f"yaw off by {off:g}°", yaw_off(n, off), "mount_yaw", (NAMES[n],), {("radar", n, "yaw_deg"): None}, within=0.5)
        for n, off in ((1, 3.0), (2, -4.0), (0, 12.0), (3, 90.0), (2, 180.0))
    ),
    Mistake("a radar's y mirrored", y_mirrored(1), "mount_y", (NAMES[1],), {("radar", 1, "y"): None}, within=0.3),
    Mistake("all y mirrored", y_mirrored(0, 1, 2, 3), "mount_y_sign", NAMES, {("radar", n, "y"): None for n in range(4)}, within=0.3),
    Mistake(
        "yaws clockwise", yaws(lambda yaw: -yaw), "mount_yaw_sign", NAMES, {("radar", n, "yaw_deg"): None for n in range(4)}, within=0.5
    ),
    Mistake("yaws in radians", yaws(math.radians), "mount_yaw_unit", NAMES, {("radar", n, "yaw_deg"): None for n in range(4)}, within=0.5),
    Mistake(
        "speed's sign",
        lambda p: p.motion_profile(r'(rear_\w+ = \{ signal = "\w+", unit = "m/s")', r"\1, sign = -1"),
        "speed_sign",
        profile={("wheel_speeds", "rear_left", "sign"): 1, ("wheel_speeds", "rear_right", "sign"): 1},
    ),
    Mistake(
        "speed's unit",
        lambda p: p.motion_profile(r'(rear_\w+ = \{ signal = "\w+", unit = )"m/s"', r'\1"km/h"'),
        "speed_unit",
        profile={("wheel_speeds", "rear_left", "unit"): "m/s", ("wheel_speeds", "rear_right", "unit"): "m/s"},
    ),
    Mistake(
        "speed's scale in the DBC",
        lambda p: p.motion_dbc(RL, RR.format("0.0025")),
        "speed_scale",
        config={("motion", "wheel_scale"): 0.8},
        within=0.02,
    ),
    Mistake(
        "wheels 2 % off",
        lambda p: p.motion_dbc(RL, RR.format("0.00204")),
        "wheel_scale",
        config={("motion", "wheel_scale"): 0.98},
        within=0.005,
    ),
    Mistake(
        "yaw rate's sign",
        lambda p: p.motion_profile(r'(yaw_rate = \{.*?unit = "rad/s")', r"\1, sign = -1"),
        "yaw_rate_sign",
        profile={("yaw_rate", "yaw_rate", "sign"): 1},
    ),
    Mistake(
        "yaw rate's unit",
        lambda p: p.motion_profile(r'(yaw_rate = \{.*?unit = )"rad/s"', r'\1"deg/s"'),
        "yaw_rate_unit",
        profile={("yaw_rate", "yaw_rate", "unit"): "rad/s"},
    ),
    Mistake(
        "yaw rate's scale in the DBC",
        lambda p: p.motion_dbc(r"(SG_ YawRate : .*?)\((\S+?),", r"\1(0.0003,"),
        "yaw_rate_scale",
        says=True,
    ),
    Mistake(
        "yaw rate 0.4 °/s off",
        lambda p: p.motion_profile(r'(yaw_rate = \{.*?unit = "rad/s")', rf"\1, offset = {math.radians(0.4):.6f}"),
        "yaw_rate_bias",
        config={("motion", "yaw_rate_bias_deg_s"): 0.4},
        within=0.1,
    ),
    Mistake("a radar 60 ms late", later((1,), 0.06), "time_offset", (NAMES[1],), {("radar", 1, "latency_ms"): 60.0}, within=15.0),
    Mistake(
        "all radars 80 ms late",
        later((0, 1, 2, 3), 0.08),
        "time_offset",
        NAMES,
        {("radar", n, "latency_ms"): 80.0 for n in range(4)},
        within=15.0,
    ),
    Mistake("a sector covered", blind_between(1, -20, 20), "blocked_sector", (NAMES[1],), says=True),
    Mistake("a radar covered", nearly_blind(2), "blocked", (NAMES[2],), says=True),
    Mistake("frames lost", dropped(2, 0.04), "lost_frames", (NAMES[2],), says=True),
    Mistake(
        "wheel speeds' byte order",
        lambda p: p.motion_dbc(r"(SG_ WheelSpeedRL : )16\|16@1", r"\g<1>23|16@0").motion_dbc(
            r"(SG_ WheelSpeedRR : )32\|16@1", r"\g<1>39|16@0"
        ),
        "byte_order",
        says=True,
    ),
    Mistake(
        "range rates' byte order",
        lambda p: p.radar_profile("kind", "kind", dbc=(r"(SG_ RangeRate_\d : \d+\|14)@1", r"\1@0")),
        "byte_order",
        NAMES,
        says=True,
    ),
    Mistake(
        "the log's channel",
        lambda p: p.sub(r'channel = "can0"', 'channel = "can0"\nlog_channel = "can5"'),
        "wrong_channel",
        config={("bus", 0, "log_channel"): "can0"},
    ),
    Mistake("a radar on another bus", on_another_bus, "wrong_bus", (NAMES[1],), {("radar", 1, "bus"): "can0"}),
    Mistake("id_offset", lambda p: p.radar(3, id_offset=0x50), "wrong_id_offset", (NAMES[3],), {("radar", 3, "id_offset"): 0x30}),
    Mistake("a radar that is not there", without(3), "radar_missing", (NAMES[3],), says=True),
    Mistake(
        "the checksum's algorithm",
        lambda p: p.radar_profile(r'algorithm = "crc32.iso_hdlc"', 'algorithm = "crc32.mpeg_2"'),
        "checksum",
        NAMES,
        says=True,
    ),
)
