"""Live CAN buses through python-can."""

from __future__ import annotations

from typing import Any

import can

from echogrid.config import Bus
from echogrid.errors import EchogridError
from echogrid.io.radar import FrameId


def open_bus(bus: Bus, ids: list[FrameId]) -> can.BusABC:
    """Opens a bus that passes only the ids that are read (in the kernel where the interface can). Raises EchogridError."""
    filters = [{"can_id": number, "can_mask": 0x1FFFFFFF if extended else 0x7FF, "extended": extended} for number, extended in ids]
    options: dict[str, Any] = {"interface": bus.interface, "channel": bus.channel, "can_filters": filters, "fd": bus.fd}
    for key in ("bitrate", "data_bitrate"):
        if getattr(bus, key) is not None:
            options[key] = getattr(bus, key)
    if bus.interface == "virtual":
        # Replays in one process: the times are the log's own, not those of the sending.
        options = {"interface": "virtual", "channel": bus.channel, "can_filters": filters, "preserve_timestamps": True}
        options["protocol"] = can.CanProtocol.CAN_FD if bus.fd else can.CanProtocol.CAN_20
    try:
        return can.Bus(**options, ignore_config=True)  # the configuration is this file alone, not ~/.canrc
    except Exception as error:  # each of python-can's interfaces raises what its driver raises
        raise EchogridError(f"bus '{bus.name}': {bus.interface} channel '{bus.channel}' cannot be opened: {error}") from error
