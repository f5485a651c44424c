"""The running service, fed in real time over virtual buses: its share of a core, its memory, and how long a window takes to go out.

`python -m tests.bench.live [SECONDS]` prints one line of JSON.
"""

from __future__ import annotations

import json
import statistics
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can

from echogrid.can.signals import bus_of
from echogrid.config.loading import load_config
from echogrid.live.player import on_virtual_buses, senders
from echogrid.live.process import begin, settle
from echogrid.live.service import Service, resident_mib
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.topics.topic import FULL, Message, Topic

DEMO = Path(__file__).parents[2] / "service" / "echogrid" / "demo_drive"


class Clock:
    """A sink: when whole windows go out, after the newest frame that was sent."""

    def __init__(self) -> None:
        self.sent_at = 0.0
        self.delays: list[float] = []

    def wants(self, *topics: Topic) -> bool:
        """Nothing for itself."""
        return False

    def put(self, message: Message) -> None:
        """As of `topics.topic.Sink`."""
        if message.topic is FULL:
            self.delays.append(time.monotonic() - self.sent_at)


def in_real_time(service: Service, log: Log, seconds: float) -> Iterator[can.Message]:
    """The frames that the service reads, of a recording's first seconds, each when it is due."""
    begun, first = time.monotonic(), 0.0
    for message in log:
        if (bus_of(message, service.config.bus), (message.arbitration_id, message.is_extended_id)) not in service.pipeline.signals.readers:
            continue
        first = first or message.timestamp
        if message.timestamp - first > seconds:
            return
        ahead = message.timestamp - first - (time.monotonic() - begun)
        if ahead > 0:
            time.sleep(ahead)
        yield message


def live(seconds: float) -> dict[str, float]:
    """The demo drive's first seconds with its own configuration, publishing included, without a subscriber."""
    begin()  # as `echogrid run` does
    drive = find_drive(DEMO, None)
    config = on_virtual_buses(load_config(drive.config, None))
    pipeline = Pipeline(config, drive.config)
    service = Service(pipeline)
    clock, found = Clock(), dict[str, float]()

    def play() -> None:
        try:
            service.live.wait(30.0)
            service.publishing.sinks.append(clock)
            buses = senders(config)
            begun, spent = time.monotonic(), time.process_time() - time.thread_time()
            for message in in_real_time(service, Log(drive.log), seconds):
                clock.sent_at = time.monotonic()
                buses[str(bus_of(message, config.bus))].send(message)
            wall = time.monotonic() - begun
            found["share_of_a_core"] = (time.process_time() - time.thread_time() - spent) / wall
            found["rss_mib"] = resident_mib()
            found["late_s"] = wall - seconds  # the machine, or the service, could not keep up
            found["dropped"] = service.receiving.queue.dropped
            for opened in buses.values():
                opened.shutdown()
        finally:
            service.workers.stop.set()

    player = threading.Thread(target=play)
    settle()
    player.start()
    service.run()
    player.join()
    delays = sorted(clock.delays)
    found["sent_to_published_ms_p50"] = statistics.median(delays) * 1e3
    found["sent_to_published_ms_p99"] = delays[int(0.99 * (len(delays) - 1))] * 1e3
    return found


if __name__ == "__main__":
    print(json.dumps(live(float(sys.argv[1]) if len(sys.argv) > 1 else 30.0)))
