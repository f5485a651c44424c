"""A recording on buses of this process: what the service would see of it."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import can

from echogrid.can.bus import LiveBus, wait
from echogrid.can.intake.frames import Frame, FrameBatch
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


def test_a_frame_that_announces_more_than_it_has_comes_as_short_as_it_is() -> None:
    """As a file may have it: a bus would count it as torn, and the player wait for it for ever."""
    short = Frame(1.0, 0x100, False, False, False, "player-c", 8, b"\x01")
    asked = Frame(2.0, 0x100, False, True, False, "player-c", 8, b"")
    bus = Bus(name="player-c", channel="player-c", interface="virtual")
    health, stop, opened = SimpleNamespace(frames=0), threading.Event(), LiveBus(bus, [(0x100, False)])
    pipeline = SimpleNamespace(signals=SimpleNamespace(readers={("player-c", (0x100, False))}), health=health)
    service: Any = SimpleNamespace(
        live=threading.Event(), config=SimpleNamespace(bus=(bus,)), pipeline=pipeline, receiving=SimpleNamespace(pace=Pace())
    )
    service.live.set()
    log: Any = SimpleNamespace(batches=lambda: iter([FrameBatch.of([short, asked])]))
    player = threading.Thread(target=Player(cast(Service, service), log).run, args=(stop,))
    player.start()
    came = list[tuple[int, bytes]]()
    while not stop.is_set():
        wait([opened], 0.05)
        for message in opened.take() or ():
            came.append((message.dlc, bytes(message.data)))
            health.frames += 1
    player.join()
    opened.close()
    assert (came, opened.health.errors) == ([(1, b"\x01"), (8, b"")], 0)
