"""More on the bus than a car has: the drive at once, twice and four times its pace, and a node that babbles at full bus load."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

from echogrid.commands.demo import on_a_free_port
from echogrid.config.loading import load_config
from echogrid.live.player import on_virtual_buses, senders
from echogrid.live.service import Service
from echogrid.pipeline import Pipeline
from tests.endurance.loop import EndlessDrive

FULL_BUS = 7_600  # frames/s: CAN at 1 Mbit/s with 8 bytes and 11-bit ids, about 131 bits each with stuffing
BURST = 0.004  # s: a sender wakes up this often and sends what is due


@dataclass(frozen=True, slots=True)
class Load:
    """`pace`: of the drive against real time. `babble`: what a node sends all the time besides at FULL_BUS, on the radars' bus: an id
    that nobody reads, or one that a radar uses, with bytes that make no scan."""

    name: str
    pace: float
    babble: int | None = None


def loads(config_ids: list[int]) -> tuple[Load, ...]:
    """`config_ids`: that the service reads on the radars' bus."""
    return (
        Load("as in the car", 1.0),
        Load("twice the frame rate", 2.0),
        Load("four times the frame rate", 4.0),
        Load("an id that nobody reads floods the bus", 1.0, 0x7EF),
        Load("a radar's own id floods the bus", 1.0, config_ids[0]),
    )


def measure(drive: Path, load: Load, seconds: float) -> dict[str, Any]:
    """The service under one load for so many seconds of wall time."""
    source = drive / "echogrid.toml"
    config = on_a_free_port(on_virtual_buses(load_config(source)))
    service = Service(Pipeline(config, source))
    endless = EndlessDrive(drive / "can.log.gz", config, source)
    result: dict[str, Any] = {"load": load.name}
    radar_bus = config.radar[0].bus
    senders = [threading.Thread(target=_play, args=(service, endless, load.pace), name="player")]
    if load.babble is not None:
        senders.append(threading.Thread(target=_babble, args=(service, radar_bus, load.babble), name="babbler"))
    watcher = threading.Thread(target=_watch, args=(service, seconds, load, result), name="watcher")
    for worker in (*senders, watcher):
        worker.start()
    service.run()
    for worker in (*senders, watcher):
        worker.join()
    return result


def _watch(service: Service, seconds: float, load: Load, result: dict[str, Any]) -> None:
    service.live.wait(60.0)
    service.workers.stop.wait(seconds)
    status = service.status()
    expected = seconds * load.pace * 1e3 / service.config.map.cycle_ms
    result.update(
        frames=status["frames"],
        maps=status["cycles"],
        share_of_maps=status["cycles"] / expected,
        latency_ms=status["latency_ms"],
        dropped_frames=status["dropped_frames"],
        motion_lost=status["lost_frames"] + status["dropped_motion"] + status["motion_dropped"],
        bad_frames=status["bad_frames"],
        scans=sum(sensor["complete"] for sensor in status["sensors"].values()),
        incomplete=sum(sensor["incomplete"] for sensor in status["sensors"].values()),
        state=status["state"],
        rss_mib=status["rss_mib"],
    )
    service.workers.stop.set()


def _play(service: Service, endless: EndlessDrive, pace: float) -> None:
    service.live.wait(60.0)
    buses = senders(service.config)
    first, started = None, time.monotonic()
    for bus, message in endless:
        first = message.timestamp if first is None else first
        ahead = (message.timestamp - first) / pace - (time.monotonic() - started)
        if ahead > 0:
            time.sleep(ahead)
        if service.workers.stop.is_set():
            break
        buses[bus].send(message)
    for opened in buses.values():
        opened.shutdown()


def _babble(service: Service, bus: str, frame_id: int) -> None:
    service.live.wait(60.0)
    buses, started, sent = senders(service.config), time.monotonic(), 0
    while not service.workers.stop.is_set():
        stamp = (service.pipeline.signals.time.newest_ns or 0) * 1e-9  # as if received now
        while sent < (time.monotonic() - started) * FULL_BUS:
            buses[bus].send(can.Message(timestamp=stamp, arbitration_id=frame_id, is_extended_id=False, data=bytes(8)))
            sent += 1
        time.sleep(BURST)
    for opened in buses.values():
        opened.shutdown()
