"""A drive that never ends: the shipped one, cut where its end goes over into its beginning, again and again at later times."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np

from echogrid.can.signals import bus_of
from echogrid.config.tables import Config
from echogrid.core.messages import Speed, YawRate
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline

SEAM = 30.0  # s at the drive's end among which the cut is looked for
COUNTERS = 16  # values of a message counter: so many frames later it stands where it stood


class EndlessDrive:
    """Iterates over (bus, message) for ever; `lap_s` is the length of one lap."""

    def __init__(self, log: Path, config: Config, source: Path) -> None:
        pipeline = Pipeline(config, source)
        readers = pipeline.signals.readers
        self.frames: list[tuple[str, can.Message]] = []
        wheels: list[tuple[float, float]] = []  # time, speed
        yaw_rates: list[float] = []
        for message in Log(log):
            bus = bus_of(message, config.bus) or ""
            if (bus, (message.arbitration_id, message.is_extended_id)) not in readers:
                continue
            self.frames.append((bus, message))
            for item in pipeline.signals.add(bus, message):
                if isinstance(item, Speed):
                    wheels.append((message.timestamp, item.speed))
                elif isinstance(item, YawRate):
                    yaw_rates.append(item.yaw_rate)
        period = wheels[1][0] - wheels[0][0]
        speed, yaw_rate = np.array([value for _, value in wheels]), np.array(yaw_rates[: len(wheels)])
        ends = np.arange(COUNTERS, min(len(speed), len(yaw_rate)), COUNTERS)
        ends = ends[ends * period > wheels[-1][0] - wheels[0][0] - SEAM]
        seam = np.abs(speed[ends] - speed[0]) + 10.0 * np.abs(yaw_rate[ends] - yaw_rate[0])
        end = wheels[int(ends[np.argmin(seam)])][0]
        self.lap_s = end - wheels[0][0]
        first = wheels[0][0]
        self.frames = [(bus, message) for bus, message in self.frames if first <= message.timestamp < end - 1e-6]

    def __iter__(self) -> Iterator[tuple[str, can.Message]]:
        lap = 0
        while True:
            for bus, message in self.frames:
                later = copy.copy(message)
                later.timestamp = message.timestamp + lap * self.lap_s
                yield bus, later
            lap += 1
