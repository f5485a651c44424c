"""Drafts of profiles: what a DBC's words and the frames say, as tables of TOML, with a remark at every line that is a guess."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from echogrid.can.database import Database, Message, Signal
from echogrid.can.profile import UNITS
from echogrid.config.editing import literal
from echogrid.surveying.counting import checksum_of, counter_of, integers, raw
from echogrid.surveying.cycles import Shape
from echogrid.surveying.groups import Group
from echogrid.surveying.words import (
    is_age,
    is_ambiguity,
    is_blockage,
    is_checksum,
    is_direction,
    is_yaw_rate,
    tokens,
    unit_of,
    wheel_of,
)

Key = tuple[str, ...]
DIMENSION = {"range": "length", "x": "length", "y": "length", "azimuth": "angle", "rcs": "radar cross section"}
GUESSED = {"length": "m", "angle": "rad", "speed": "m/s", "turn rate": "rad/s", "radar cross section": "dBsm"}
MOST_SEEN = 4000  # frames that are looked at


@dataclass(slots=True)
class Draft:
    """A profile as tables; `remarks` by key: why the line is uncertain. `dbc`: the file that it reads. `heard`: of a skeleton, messages
    that the recording has all the same."""

    kind: str
    dbc: Path
    tables: dict[str, Any] = field(default_factory=dict)
    remarks: dict[Key, str] = field(default_factory=dict)
    heard: tuple[str, ...] = ()

    @property
    def document(self) -> dict[str, Any]:
        return {"kind": self.kind, "dbc": str(self.dbc), **self.tables}

    def text(self, about: Sequence[str], folder: Path) -> str:
        """TOML for a file in that folder, with the remarks behind their lines."""
        document = self.document | {"dbc": seen_from(folder, self.dbc)}
        plain = [(key, value) for key, value in document.items() if not isinstance(value, dict)]
        lines = [f"# {line}" for line in about]
        lines += [self._line((), key, value) for key, value in plain]
        for table, values in self.tables.items():
            if isinstance(values, dict):
                lines += ["", f"[{table}]", *(self._line((table,), key, value) for key, value in values.items())]
        return "\n".join(lines) + "\n"

    def _line(self, before: Key, key: str, value: Any) -> str:
        remark = self.remarks.get((*before, key))
        return f"{key} = {literal(value)}" + (f"  # uncertain: {remark}" if remark else "")


def seen_from(folder: Path, path: Path) -> str:
    """Relative where both lie in one tree, else absolute."""
    relative = os.path.relpath(path.resolve(), folder.resolve())
    return str(path.resolve()) if relative.startswith("..") else relative


def radar_draft(group: Group, shape: Shape | None, dbc: Path) -> Draft:
    """Of a group; without a shape a skeleton, whose cycle is left open."""
    draft = Draft("radar", dbc)
    if shape is None:
        draft.tables["timeout_ms"] = 100.0
        draft.remarks["timeout_ms",] = (
            "how a cycle is put together could not be seen: give [header] or ends_with and frames (dbc/README.md)"
        )
    else:
        if shape.frames is not None:
            draft.tables["frames"] = shape.frames
        if shape.ends_with is not None:
            draft.tables["ends_with"] = shape.ends_with
        if shape.agrees < 0.95:
            draft.remarks["ends_with" if shape.ends_with else "frames",] = f"{shape.agrees:.0%} of the cycles in the recording are so"
        if shape.header is not None:
            draft.tables["header"] = _header(shape, shape.header)
    detections: dict[str, Any] = {"messages": group.name}
    if group.n is not None:
        detections["n"] = list(group.n)
    if shape is not None:
        known = {"page": shape.page, "cycle": shape.detections_cycle, "cycle_bits": shape.cycle_bits}
        detections |= {key: value for key, value in known.items() if value is not None}
    if group.per_frame > 1 or group.first_k != 1:
        detections |= {"per_frame": group.per_frame, "first_k": group.first_k}
    for role in ("range", "azimuth", "x", "y", "range_rate", "vx", "vy", "rcs"):
        if role in group.roles:
            detections[role], remark = quantity(group.signal(role), group.roles[role], DIMENSION.get(role, "speed"))
            if remark:
                draft.remarks["detections", role] = remark
    if "valid" in group.roles:
        away = {"invalid", "ungueltig"} & set(tokens(group.roles["valid"]))
        detections["valid"] = {"signal": group.roles["valid"], "one_of": [0 if away else 1]}
        if group.signal("valid").length > 1:
            draft.remarks["detections", "valid"] = "which values mean that there is a detection"
    if shape is not None and shape.frame_crc is not None:
        detections["crc"] = dict(zip(("signal", "algorithm"), shape.frame_crc, strict=True))
    if shape is not None and shape.crc is not None:
        draft.tables["crc"] = dict(zip(("message", "signal", "algorithm"), shape.crc, strict=True))
    draft.tables["detections"] = detections
    return draft


def unread_checksums(group: Group, shape: Shape) -> list[str]:
    """Signals that are named checksums, where none was understood: their frames are taken unchecked."""
    if shape.crc is not None or shape.frame_crc is not None:
        return []
    messages = [group.messages[0], *([shape.header] if shape.header is not None else [])]
    return [f"{message.name}.{s.name}" for message in messages for s in message.signals if is_checksum(s)]


def _header(shape: Shape, message: Message) -> dict[str, Any]:
    table: dict[str, Any] = {"message": message.name}
    if shape.cycle is not None:
        table["cycle"] = shape.cycle
    if shape.count:
        table["count"] = list(shape.count)
    for key, asked in (("age", is_age), ("ambiguity", is_ambiguity), ("blockage", is_blockage)):
        signal = next((s for s in message.signals if asked(s) and s.name not in shape.count), None)
        if signal is not None:
            table[key] = {"signal": signal.name, "unit": unit_of(signal)}
    return table


def quantity(signal: Signal, name: str, dimension: str) -> tuple[dict[str, Any], str | None]:
    """As a profile has it, and what is uncertain about it."""
    unit = unit_of(signal)
    if unit is not None and unit in UNITS[dimension]:
        return {"signal": name, "unit": unit}, None
    said = f"'{signal.unit}'" if signal.unit else "no unit"
    return {"signal": name, "unit": GUESSED[dimension]}, f"the DBC says {said}; one of {', '.join(UNITS[dimension])}"


@dataclass(frozen=True, slots=True)
class MotionSignals:
    """The messages and signals that may be wheel speeds and the yaw rate; `rear` two names, or one twice."""

    wheels: Message
    rear: tuple[Signal, Signal]
    turning: Message
    yaw_rate: Signal

    def score(self) -> tuple[float, ...]:
        """Two wheels before one speed; then units that are said; then short names."""
        own = self.rear[0].name != self.rear[1].name
        said = sum(unit_of(s) is not None for s in (*self.rear, self.yaw_rate))
        return float(own), float(said), -float(len(self.rear[0].name) + len(self.yaw_rate.name))


def motion_signals(database: Database) -> list[MotionSignals]:
    """All pairs of speed and yaw rate in a database, the likeliest first."""
    usable = [message for message in database.messages if message.fault is None and 0 < message.length <= 64]
    speeds: list[tuple[Message, tuple[Signal, Signal]]] = []
    for message in usable:
        read = [signal for signal in message.signals if signal.name not in message.unread]
        told = {role: signal for signal in read if (role := wheel_of(signal, message.name)) is not None}
        if "rear_left" in told and "rear_right" in told:
            speeds.append((message, (told["rear_left"], told["rear_right"])))
        elif "speed" in told:
            speeds.append((message, (told["speed"], told["speed"])))
    rates = [(message, s) for message in usable for s in message.signals if is_yaw_rate(s) and s.name not in message.unread]
    found = [MotionSignals(*speed, *rate) for speed in speeds for rate in rates]
    return sorted(found, key=lambda one: one.score(), reverse=True)


def motion_draft(signals: MotionSignals, dbc: Path, wheels: Sequence[bytes], turning: Sequence[bytes]) -> tuple[Draft, bool]:
    """With counters and checksums as the payloads of both messages show them; and whether a wheel radius is needed."""
    draft = Draft("motion", dbc)
    table: dict[str, Any] = {"message": signals.wheels.name}
    turns = unit_of(signals.rear[0]) in UNITS["turn rate"]
    for key, signal in zip(("rear_left", "rear_right"), signals.rear, strict=True):
        table[key], remark = quantity(signal, signal.name, "turn rate" if turns else "speed")
        table[key] |= _validity(signals.wheels, signal, wheels)
        if signals.rear[0].name == signals.rear[1].name:
            remark = "the speed of the car; no signals of rear wheels were found"
        if remark:
            draft.remarks["wheel_speeds", key] = remark
    draft.tables["wheel_speeds"] = table | _checked(signals.wheels, wheels)
    if (way := next((s for s in integers(signals.wheels) if is_direction(s)), None)) is not None:
        draft.remarks["wheel_speeds", "message"] = f"the car is taken to go forward; {way.name} may tell: see [direction] in dbc/README.md"
    table = {"message": signals.turning.name}
    table["yaw_rate"], remark = quantity(signals.yaw_rate, signals.yaw_rate.name, "turn rate")
    table["yaw_rate"] |= _validity(signals.turning, signals.yaw_rate, turning) | _sign_bit(signals.turning, signals.yaw_rate)
    if remark:
        draft.remarks["yaw_rate", "yaw_rate"] = remark
    draft.tables["yaw_rate"] = table | _checked(signals.turning, turning)
    return draft, turns


def _checked(message: Message, payloads: Sequence[bytes]) -> dict[str, Any]:
    payloads = payloads[:MOST_SEEN]
    counter, checksum = counter_of(message, payloads), checksum_of(message, payloads)
    known: dict[str, Any] = {} if counter is None else {"counter": counter.name}
    return known if checksum is None else {**known, "crc": {"signal": checksum[0].name, "algorithm": checksum[1]}}


def _validity(message: Message, signal: Signal, payloads: Sequence[bytes]) -> dict[str, Any]:
    """A flag of one bit whose name begins with the signal's, and that is mostly 1."""
    for flag in integers(message):
        valid = set(tokens(flag.name)) & {"valid", "validity", "vld"}
        if flag.length == 1 and flag.name.startswith(signal.name) and valid and payloads and sum(raw(flag, payloads)) > len(payloads) / 2:
            return {"valid": {"signal": flag.name, "one_of": [1]}}
    return {}


def _sign_bit(message: Message, signal: Signal) -> dict[str, Any]:
    """A sign in a bit of its own, of a magnitude."""
    if signal.is_signed or signal.offset < 0 or signal.scale < 0:
        return {}
    bit = next((s for s in integers(message) if s.length == 1 and set(tokens(s.name)) & {"sign", "vz", "vorzeichen"} and is_turn(s)), None)
    return {} if bit is None else {"negative_if": {"signal": bit.name, "one_of": [1]}}


def is_turn(signal: Signal) -> bool:
    return any(word.startswith(("yaw", "gier")) for word in tokens(signal.name))
