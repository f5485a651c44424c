"""A recording on buses of this process: what the service would see of it."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import can

from echogrid.config.tables import Bus
from echogrid.live.pace import Pace
from echogrid.live.player import APART, Player
from echogrid.live.service import Service
from echogrid.logs.log import Log


def test_a_bus_that_is_read_slowly_is_not_left_behind(tmp_path: Path) -> None:
    """Else one bus's motion comes long after the other's scans, and the map is another than that of the file."""
    names, step = ("player-a", "player-b"), 0.01
    frames = [(1.6e9 + n * step, name) for n in range(60) for name in names]
    (tmp_path / "a.log").write_text("".join(f"({at:.6f}) {name} 100#00\n" for at, name in frames))
    health = SimpleNamespace(frames=0)
    pipeline = SimpleNamespace(signals=SimpleNamespace(readers={(name, (0x100, False)) for name in names}), health=health)
    config = SimpleNamespace(bus=tuple(Bus(name=name, channel=name, interface="virtual") for name in names))
    receiving = SimpleNamespace(pace=Pace())
    service: Any = SimpleNamespace(live=threading.Event(), config=config, pipeline=pipeline, receiving=receiving)
    came, stop = list[float](), threading.Event()

    def receive(bus: can.BusABC, pause: float) -> None:
        while not stop.is_set():
            message = bus.recv(0.05)
            if message is not None:
                came.append(message.timestamp)
                health.frames += 1
                time.sleep(pause)

    buses = [can.Bus(interface="virtual", channel=name, preserve_timestamps=True) for name in names]
    threads = [threading.Thread(target=receive, args=(bus, pause)) for bus, pause in zip(buses, (0.0, 0.005), strict=True)]
    for thread in threads:
        thread.start()
    service.live.set()
    Player(cast(Service, service), Log(tmp_path / "a.log")).run(stop)
    for thread, bus in zip(threads, buses, strict=True):
        thread.join()
        bus.shutdown()
    assert len(came) == len(frames)
    behind = max(max(came[: n + 1]) - at for n, at in enumerate(came))
    assert behind <= APART + step + 1e-6
