"""What every frame of our DBC files needs: raw values, a checksum, an end.

Encoded by cantools, which shares nothing with the service's decoder.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import can
import numpy as np
from cantools.database.can import Database, Signal
from cantools.database.can import Message as DbcMessage
from numpy.typing import NDArray

from echogrid.can.profile import shipped
from echogrid.core.messages import Floats

Raw = NDArray[np.int64]


@dataclass(slots=True)
class Report:
    """What became of a recording's content on the bus."""

    cycles: int = 0
    sent: int = 0  # detections
    unencodable: int = 0  # detections with a value that no signal can hold, or none
    beyond_nearest: int = 0  # detections left out since 64 nearer ones were there
    invalid_motion: int = 0  # wheel speeds and yaw rates sent as invalid, since no signal can hold them
    frames: int = 0
    loads: dict[str, float] = field(default_factory=dict)  # share of each bus's time


def load_dbc(name: str) -> Database:
    """One of the DBC files that echogrid ships."""
    database = Database()
    database.add_dbc_file(str(shipped() / f"{name}.dbc"))
    return database


def quantise(signal: Signal, values: Floats) -> tuple[Raw, NDArray[np.bool_]]:
    """The raw values (N,) nearest to physical ones in the DBC's unit, and which of them the signal can hold; the others are 0."""
    steps = np.round((values - float(signal.offset)) / float(signal.scale))
    if signal.is_signed:
        low, high = -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    else:
        low, high = 0, (1 << signal.length) - 1
    fits = (steps >= low) & (steps <= high)  # False for NaN
    return np.where(fits, steps, 0.0).astype(np.int64), fits


def sealed(message: DbcMessage, signals: Mapping[str, int], crc: Callable[[bytes], int], more: bytes = b"") -> bytes:
    """The payload of raw values, with `crc` over its other bytes and then `more` in its signal Crc."""
    payload = message.encode({**signals, "Crc": 0}, scaling=False, strict=False)
    place = message.get_signal_by_name("Crc")
    first, count = place.start // 8, place.length // 8
    value = crc(payload[:first] + payload[first + count :] + more)
    return payload[:first] + value.to_bytes(count, "little") + payload[first + count :]


def frame(can_id: int, data: bytes, end_us: int, fd: bool) -> can.Message:
    """A frame that ends at `end_us`."""
    return can.Message(
        timestamp=end_us / 1e6, arbitration_id=can_id, is_extended_id=False, is_fd=fd, bitrate_switch=fd, data=data, dlc=len(data)
    )
