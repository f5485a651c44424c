"""ROS's diagnostics in CDR (`cdr`), and back. What echogrid says in them: `diagnostics`."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from echogrid.topics.cdr import LENGTH, LITTLE_ENDIAN, aligned, body_of, encode_header, padded, read, read_header, read_texts, with_texts

_LEVEL = struct.Struct("<B")


class Level(IntEnum):
    """How a part is doing, as diagnostic_msgs/DiagnosticStatus numbers it."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class DiagnosticStatus:
    """diagnostic_msgs/DiagnosticStatus: one part of a machine."""

    level: Level
    name: str  # "program: part"
    message: str
    hardware_id: str
    values: Mapping[str, str]  # in their order; of a key that came twice the last


@dataclass(frozen=True, slots=True)
class DiagnosticArray:
    """diagnostic_msgs/DiagnosticArray: how all parts are doing at one time."""

    stamp_ns: int
    frame: str
    status: tuple[DiagnosticStatus, ...]


def encode_diagnostics(array: DiagnosticArray) -> bytes:
    """The diagnostics as diagnostic_msgs/msg/DiagnosticArray."""
    body = encode_header(array.stamp_ns, array.frame) + LENGTH.pack(len(array.status))
    for status in array.status:
        body = with_texts(body + _LEVEL.pack(status.level), (status.name, status.message, status.hardware_id))
        body = padded(body, 4) + LENGTH.pack(len(status.values))
        body = with_texts(body, (text for pair in status.values.items() for text in pair))
    return LITTLE_ENDIAN + body


def decode_diagnostics(payload: bytes) -> DiagnosticArray:
    """The diagnostics of a diagnostic_msgs/msg/DiagnosticArray."""
    body = body_of(payload)
    stamp_ns, frame, at = read_header(body)
    (count,) = read(LENGTH, body, at)
    at += LENGTH.size
    status = []
    for _ in range(count):  # however many there should be, the payload's end ends it
        (level,) = read(_LEVEL, body, at)
        if level > max(Level):
            raise ValueError(f"a diagnostic level of {level}, expected 0 ... {max(Level)}")
        (name, message, hardware_id), at = read_texts(body, at + _LEVEL.size, 3)
        at = aligned(at, 4)
        (pairs,) = read(LENGTH, body, at)
        texts, at = read_texts(body, at + LENGTH.size, 2 * pairs)
        values = dict(zip(texts[::2], texts[1::2], strict=True))
        status.append(DiagnosticStatus(Level(level), name, message, hardware_id, values))
    if at != len(body):
        raise ValueError(f"{len(body) - at} bytes are left over after the diagnostics")
    return DiagnosticArray(stamp_ns, frame, tuple(status))
