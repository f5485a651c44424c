"""The time of a frame: that of the bus and that of a text log of it are one."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator
from pathlib import Path

import can
from tests.support import frames

from echogrid.can.intake.frames import FrameBatch
from echogrid.can.intake.table import UNKNOWN_BUS
from echogrid.can.signals import SignalReader, bus_of, buses_of
from echogrid.config.loading import load_config
from echogrid.config.tables import Bus
from echogrid.core.health import Health


def times_ns(path: Path, messages: Iterable[can.Message]) -> Iterator[int | None]:
    reader = SignalReader(load_config(path), path, Health())
    for message in messages:
        reader.add("can0", message)
        yield reader.newest_ns


def test_a_text_log_has_the_microseconds_of_the_bus(tmp_path: Path) -> None:
    """Of the kernel's nanoseconds an eighth end so near to half a microsecond that a float's product falls on the other side."""
    path = tmp_path / "echogrid.toml"
    path.write_text(frames.CONFIG)
    source = random.Random(1)
    every_ms = [(n // 1000, n % 1000 * 1_000_000 + source.randrange(1_000_000)) for n in range(2000)]
    heard = [1732547000 + seconds + nanoseconds * 1e-9 for seconds, nanoseconds in every_ms]  # as python-can adds them up
    with can.CanutilsLogWriter(tmp_path / "can.log") as writer:
        for timestamp in heard:
            writer.on_message_received(can.Message(timestamp=timestamp, arbitration_id=0x7FF, is_extended_id=False, channel="can0"))
    live = times_ns(path, (can.Message(timestamp=timestamp) for timestamp in heard))
    assert list(live) == list(times_ns(path, can.LogReader(tmp_path / "can.log")))


def test_many_frames_are_of_the_buses_that_each_is_of() -> None:
    """By all names and numbers that files have; a bus may have any name, as that of what is none."""
    buses = (Bus(name="None", channel="can1"), Bus(name="-1", channel="can0"), Bus(name="c", channel="can7", log_channel=5))
    names = [bus.name for bus in buses]
    channels = [None, "", 0, 1, 2, 5, 6, 7, "can0", "can1", "can5", "can7", "None", "c", "vcan0"]
    messages = [can.Message(channel=channel) for channel in channels]
    alone = [bus_of(message, buses) for message in messages]
    assert set(names) | {None} == set(alone)
    expected = [UNKNOWN_BUS if bus is None else names.index(bus) for bus in alone]
    assert buses_of(FrameBatch.of(messages), buses).tolist() == expected
    assert [buses_of(FrameBatch.of([message]), buses).item() for message in messages] == expected
