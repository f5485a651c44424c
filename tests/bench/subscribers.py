"""What subscribers cost and how long they wait: `python -m tests.bench.subscribers`, on the loopback, with the shipped drive.

python -m tests.bench.subscribers watch ENDPOINT    is a subscriber: at the end of its input it prints the sequence numbers that came
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable

import can
import msgspec
import numpy as np
import zenoh

from echogrid.can.signals import bus_of
from echogrid.client import Client
from echogrid.config.loading import load_config
from echogrid.config.tables import Config, Publish, Ros
from echogrid.core.map.map_delta import around, key_window
from echogrid.core.mapper import MapUpdate
from echogrid.core.motion.error_filter import Certainty
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.logs.drive import Drive, find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.topics.announcer import Announcer, Snapshot
from echogrid.zenoh.attachment import decode_grid_attachment
from echogrid.zenoh.map_reader import MapReader
from echogrid.zenoh.publisher import Publisher, session_config
from echogrid.zenoh.region import Regions
from tests.support import one_by_one
from tests.support.places import DEMO
from tests.support.ports import free_port
from tests.support.routers import router

KEYS = "echogrid/v1/car/grid/fused/*"
RATE = 20.0  # maps a second


def main() -> None:
    drive = find_drive(DEMO, None)
    config = msgspec.structs.replace(load_config(drive.config, "analytic"), vehicle="car")
    for cells in (256, 1024):
        frozen(config, cells)
        joiners(config, cells)
    restarts(config)
    regions(config, drive)


def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def told(what: str, seconds: list[float]) -> None:
    ms = np.array(seconds) * 1e3
    print(f"{what}: {np.percentile(ms, 50):.1f} ms at the median, {np.percentile(ms, 99):.1f} p99, {ms.max():.1f} at most, n = {len(ms)}")


class Car:
    """Drives straight on through a map of noise that changes a little with every step, and announces it."""

    def __init__(self, config: Config, cells: int, publisher: Publisher) -> None:
        self.announcer, self.publisher, self.cells = Announcer(config, ""), publisher, cells
        self.random = np.random.default_rng(0)
        self.world = self.random.normal(0, 2, (cells + 64, cells + 64)).astype(np.float32)
        self.step = 0

    def announce(self) -> float:
        """One map; how long that took."""
        self.step += 1
        ego = EgoState(time.time_ns(), SE2(self.step * 0.5, 0, 0), 10.0, 0.0)
        window = around(ego.odom_from_base, 30 / 128, self.cells)
        key = key_window(window)
        seen = window.joined(key)
        middle = slice(self.cells // 2 - 64, self.cells // 2 + 64)
        self.world[middle, middle] += self.random.normal(0, 0.2, (128, 128)).astype(np.float32)
        update = MapUpdate(ego, self.random.normal(0, 10, (100, 2)))
        snapshot = Snapshot(update, Certainty(np.eye(3), np.eye(2)), 0, window, key, seen, self.world[: seen.height, : seen.width])
        started = time.monotonic()
        for message in self.announcer.map(snapshot):
            self.publisher.put(message)
        return time.monotonic() - started


def drive_for(car: Car, seconds: float) -> list[float]:
    began, took = time.monotonic(), []
    while time.monotonic() - began < seconds:
        took.append(car.announce())
        time.sleep(max(0.0, 1 / RATE - took[-1]))
    return took


def watch(address: str) -> None:
    """Sequence numbers of all that comes, by key."""
    with zenoh.open(session_config((), (address,), sends=False)) as session:
        subscriber = session.declare_subscriber(KEYS)
        ended = threading.Event()
        threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
        came: dict[str, list[int]] = {}
        while not ended.is_set():
            sample = subscriber.try_recv()
            if sample is None:
                time.sleep(0.001)
                continue
            name = str(sample.key_expr)
            came.setdefault(name, []).append(decode_grid_attachment(bytes(sample.attachment))[0])
        print(json.dumps(came), flush=True)


def frozen(config: Config, cells: int) -> None:
    """Two subscribers of all grids; one stops reading for 15 s."""
    address = endpoint()
    command = [sys.executable, "-m", "tests.bench.subscribers", "watch", address]
    with Publisher(Publish(listen=(address,), window_cells=cells), "car", Ros()) as publisher:
        car = Car(config, cells, publisher)
        watchers = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(2)]
        drive_for(car, 3.0)
        print(f"{cells} x {cells} cells at {RATE:.0f} Hz, six messages a map, two subscribers of all grids")
        told("  announcing, both read", drive_for(car, 10.0))
        os.kill(watchers[1].pid, signal.SIGSTOP)
        told("  announcing, one is frozen", drive_for(car, 15.0))
        os.kill(watchers[1].pid, signal.SIGCONT)
        told("  announcing, it reads again", drive_for(car, 10.0))
        time.sleep(1.0)
        for name, watcher in zip(("healthy", "frozen"), watchers, strict=True):
            came = json.loads(watcher.communicate()[0])
            for key, numbers in sorted(came.items()):
                sent = numbers[-1] - numbers[0] + 1
                print(f"  the {name} one lost {sent - len(numbers)} of {sent} of {key.rpartition('/')[2]}")


def joiners(config: Config, cells: int) -> None:
    """How long a client waits for its first map, from nothing and when it is connected."""
    address = endpoint()
    with Publisher(Publish(listen=(address,), window_cells=cells), "car", Ros()) as publisher:
        car = Car(config, cells, publisher)
        for _ in range(5):
            car.announce()
        for name, read in (("grid", Client.grid), ("follow", Client.follow)):
            cold, warm = [], []
            for _ in range(30):
                started = time.monotonic()
                with Client(address) as client:
                    assert read(client, 10.0) is not None
                    cold.append(time.monotonic() - started)
            for _ in range(30):
                with Client(address) as client:
                    while not client.alive():
                        pass
                    started = time.monotonic()
                    assert read(client, 10.0) is not None
                    warm.append(time.monotonic() - started)
            told(f"  late joiner, {name}, from nothing", cold)
            told(f"  late joiner, {name}, of a connected client", warm)


def restarts(config: Config) -> None:
    """A router is killed, and 5 s later another one is there: how long until a client has the key frame of then."""
    took = []
    for _ in range(5):
        address = endpoint()
        with Publisher(Publish(listen=(), connect=(address,)), "car", Ros()) as publisher, Client(address) as client:
            car = Car(config, 256, publisher)
            with router(address):
                car.announce()
                assert client.follow(20.0) is not None
            drive_for(car, 5.0)
            with router(address):
                started = time.monotonic()
                while client.follow(0.01) is None:
                    car.announce()
                took.append(time.monotonic() - started)
    told("router back after 5 s, until the client follows again", took)


def regions(config: Config, drive: Drive) -> None:
    """The shipped drive mapped in its own time, with and without queries one after the other."""
    messages = [message for message in Log(drive.log) if message.timestamp]
    first = messages[0].timestamp
    short = [message for message in messages if message.timestamp < first + 25]

    def mapped(meanwhile: Callable[[Pipeline, threading.Lock], None]) -> list[float]:
        pipeline, lock, took = Pipeline(config, drive.config), threading.Lock(), []
        helper = threading.Thread(target=meanwhile, args=(pipeline, lock))
        helper.start()
        began = time.monotonic()
        for message in short:
            time.sleep(max(0.0, message.timestamp - first - (time.monotonic() - began)))
            started = time.monotonic()
            if added(pipeline, lock, message):
                took.append(time.monotonic() - started)
        done.set()
        helper.join()
        done.clear()
        return took

    def added(pipeline: Pipeline, lock: threading.Lock, message: can.Message) -> bool:
        with lock:
            return bool(one_by_one.mapped(pipeline, bus_of(message, config.bus) or "", message))

    def asked(side: float) -> Callable[[Pipeline, threading.Lock], None]:
        def ask(pipeline: Pipeline, lock: threading.Lock) -> None:
            address, stop, took = endpoint(), threading.Event(), []
            with Publisher(Publish(listen=(address,)), "car", Ros()) as publisher, Client(address) as client:
                answering = Regions(publisher, config.grid.cell, MapReader(pipeline.mapper, lock, None))
                thread = threading.Thread(target=answering.run, args=(stop,))
                thread.start()
                while client.region((0, 0, 1, 1)) is None:
                    time.sleep(0.01)
                while not done.is_set():
                    started = time.monotonic()
                    assert client.region((-side / 2, -side / 2, side / 2, side / 2)) is not None
                    took.append(time.monotonic() - started)
                stop.set()
                answering.wake()
                thread.join()
            told(f"  region of {side:.0f} m x {side:.0f} m, packed", took)

        return ask

    done = threading.Event()
    told("map update without queries", mapped(lambda *_: None))
    for side in (60.0, 470.0):
        told(f"map update, one query of {side:.0f} m after the other", mapped(asked(side)))


if __name__ == "__main__":
    watch(sys.argv[2]) if sys.argv[1:2] == ["watch"] else main()
