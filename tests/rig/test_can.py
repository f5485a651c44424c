"""`echogrid run` on real CAN interfaces. Where this machine has none, test_guest.py runs this file in a guest that has."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from echogrid.can.intake.frames import FrameBatch
from echogrid.can.signals import SignalReader
from echogrid.client import Client
from echogrid.commands.recorder import Recorder
from echogrid.config.loading import load_config
from echogrid.core.health import Health
from echogrid.maps.map_files import sha256
from echogrid.pipeline import Pipeline
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore
from tests.rig import real_bus
from tests.rig.real_bus import CHASSIS, RADARS
from tests.support.one_by_one import mapped
from tests.support.ports import free_port

PATIENCE = 60.0  # s


@pytest.fixture(scope="module", autouse=True)
def _interfaces() -> Iterator[None]:
    try:
        with real_bus.interfaces():
            yield
    except real_bus.NoInterfacesError as why:
        if os.environ.get("RIG") in ("guest", "here"):
            raise
        pytest.skip(f"{why}; test_guest.py runs this in a guest, tests/live/test_service.py covers it on virtual buses")


class Running:
    """`echogrid run` in a process of its own, and a client of it."""

    def __init__(self, folder: Path, *, one_bus: bool, model: str = "analytic") -> None:
        port = free_port()
        self.folder = folder
        self.config = folder / "echogrid.toml"
        text = real_bus.configuration(port, model)
        self.config.write_text(text.replace('bus = "chassis"', 'bus = "radars"') if one_bus else text)
        signals = SignalReader(load_config(self.config), self.config, Health())
        self.ids = {CHASSIS: {number for number, _ in signals.ids("chassis")}, RADARS: {number for number, _ in signals.ids("radars")}}
        self.log = folder / "log"
        with self.log.open("w") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-W", "error", "-m", "echogrid", "run", "-c", str(self.config)],
                env={**os.environ, "STATE_DIRECTORY": str(folder)},
                stderr=errors,
            )
        self.endpoint = f"tcp/127.0.0.1:{port}"
        self.client = Client(self.endpoint, real_bus.VEHICLE)

    def read(self, messages: list[can.Message]) -> list[can.Message]:
        """Those that the service reads."""
        return [message for message in messages if message.arbitration_id in self.ids[str(message.channel)]]

    def status_when(self, what: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The first status of which this is true."""
        deadline = time.monotonic() + PATIENCE
        status: dict[str, Any] | None = None
        while time.monotonic() < deadline and self.process.poll() is None:
            status = self.client.status(timeout=2.0) or status
            if status is not None and what(status):
                return status
        raise AssertionError(f"this did not come about; the last status is {status}\n{self.log.read_text()}")

    def stop(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(PATIENCE) == 0, self.log.read_text()
        assert "Traceback" not in self.log.read_text()


@contextmanager
def running(folder: Path, *, one_bus: bool, model: str = "analytic") -> Iterator[Running]:
    service = Running(folder, one_bus=one_bus, model=model)
    with service.process, service.client:
        try:
            service.status_when(lambda _: True)
            yield service
        finally:
            service.process.kill()  # nothing, where it ended by itself


def drained(bus: can.BusABC) -> list[can.Message]:
    """What the kernel kept."""
    kept = []
    while (message := bus.recv(0)) is not None:
        kept.append(message)
    return kept


def kernel_filters(interface: str) -> set[int]:
    """The ids that sockets listen for on an interface, as the kernel itself lists them."""
    rows = [line.split() for name in ("sff", "fil") for line in Path(f"/proc/net/can/rcvlist_{name}").read_text().splitlines()]
    return {int(row[1], 16) for row in rows if row and row[0] == interface}


def test_a_drive_gives_the_map_of_the_kernels_own_record(tmp_path: Path) -> None:
    """Kernel stamps and filters: to the last bit what a replay makes of what the kernel stamped and let through."""
    messages = real_bus.drive(4.0, everything_on=RADARS)
    with running(tmp_path, one_bus=True) as service, real_bus.senders() as buses, real_bus.capture() as everything:
        service.client.grid(timeout=0)
        assert kernel_filters(RADARS) == service.ids[RADARS]
        assert kernel_filters(CHASSIS) == set()
        real_bus.play(messages, buses)
        read = service.read(messages)
        status = service.status_when(lambda status: status["frames"] >= len(read))
        grid = service.client.grid()
        service.stop()
        recorded = drained(everything)

    assert len(recorded) == len(messages) > len(read)  # the drive has an id that nobody reads
    assert (status["frames"], status["unknown_frames"], status["dropped_frames"]) == (len(read), 0, 0)
    recorder = Recorder(Pipeline(load_config(service.config), service.config))
    kept = FrameBatch.of(service.read(recorded))
    assert all(end <= len(kept) for end, _ in recorder.take(kept, np.full(len(kept), recorder.pipeline.signals.number("radars"))))
    offline = recorder.write(tmp_path / "offline", None)
    assert offline["cycles"] == status["cycles"] > 30  # of 80 or so: where the machine is slow, frames come in heaps
    with TileStore(tmp_path / "map.egmap") as store:
        kept = stored_map(store, store.numbers()[-1])
        row, column, log_odds = kept.whole()
        cell = kept.spec.cell
        assert (log_odds > 1).sum() > 100
        assert sha256(log_odds, (column * cell, row * cell), cell) == offline["map_sha256"]

        assert grid is not None
        column, row = np.rint(np.array(grid.origin) / cell).astype(int).tolist()
        published = kept.window(row, column, *grid.occupancy.shape) > 0
        assert ((grid.occupancy > 50) != published).mean() < 0.01  # the last window went out up to 1 / rate_hz before the end


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, _interfaces: None) -> Iterator[Running]:
    """On two buses, classic and FD, for all of the following tests."""
    with running(tmp_path_factory.mktemp("two_buses"), one_bus=False) as running_service:
        yield running_service
        running_service.stop()


def test_two_buses_lose_nothing(service: Running) -> None:
    """Every scan arrives whole. The map is not a replay's to the bit: which bus's frame is taken in first is up to the scheduler."""
    messages = real_bus.drive(3.0)
    with real_bus.senders() as buses, real_bus.capture() as everything:
        real_bus.play(messages, buses)
        counts = Counter(str(message.channel) for message in service.read(messages))
        status = service.status_when(lambda status: status["frames"] == counts.total())
        recorded = drained(everything)
    for name, channel in (("chassis", CHASSIS), ("radars", RADARS)):
        assert kernel_filters(channel) == service.ids[channel]
        assert status["buses"][name] == {"frames": counts[channel], "errors": 0, "overflow": 0, "bus_off": 0, "reconnects": 0, "up": True}
    offline = Pipeline(load_config(service.config), service.config)
    for message in service.read(recorded):
        mapped(offline, "chassis" if message.channel == CHASSIS else "radars", message)
    assert {name: sensor["complete"] for name, sensor in status["sensors"].items()} == {
        name: sensor.complete for name, sensor in offline.health.sensors.items()
    }
    assert (status["detections"], status["unknown_frames"], status["dropped_frames"]) == (offline.health.detections, 0, 0)


def test_an_interface_that_goes_down_comes_back(service: Running) -> None:
    before = service.status_when(lambda _: True)
    real_bus.up(RADARS, False)
    service.status_when(lambda status: not status["buses"]["radars"]["up"])
    real_bus.up(RADARS, True)
    after = service.status_when(lambda status: status["buses"]["radars"]["up"])
    assert {name: bus["reconnects"] for name, bus in after["buses"].items()} == {"chassis": 0, "radars": 1}
    messages = real_bus.drive(1.0)
    with real_bus.senders() as buses:
        real_bus.play(messages, buses)
    frames = len(service.read(messages))
    assert service.status_when(lambda status: status["frames"] == before["frames"] + frames)["cycles"] > after["cycles"]
    assert "is back" in service.log.read_text()


def test_error_frames_and_bus_off_are_counted_and_survived(service: Running) -> None:
    """vcan hands on an error frame as a controller's driver would make it."""
    frame = next(message for message in real_bus.drive(1.0) if message.channel == RADARS)
    with real_bus.senders() as buses:
        for kind in (0x4, 0x40):  # linux/can/error.h: the controller's warning, bus-off
            buses[RADARS].send(can.Message(is_error_frame=True, arbitration_id=kind, dlc=8, is_extended_id=False))
        bus = service.status_when(lambda status: status["buses"]["radars"]["errors"] == 2)["buses"]["radars"]
        assert (bus["bus_off"], bus["up"]) == (1, False)
        buses[RADARS].send(frame)
        service.status_when(lambda status: status["buses"]["radars"]["up"])


def test_what_overflows_in_the_kernel_is_counted_to_the_frame(service: Running) -> None:
    frame = next(message for message in real_bus.drive(1.0) if message.channel == RADARS)
    sent = 6000  # twice what its receive buffer holds
    before = service.status_when(lambda _: True)["buses"]["radars"]
    with real_bus.senders() as buses:
        service.process.send_signal(signal.SIGSTOP)
        for _ in range(sent):
            buses[RADARS].send(frame)
        service.process.send_signal(signal.SIGCONT)

    def all_accounted_for(status: dict[str, Any]) -> bool:
        bus = status["buses"]["radars"]
        return int(bus["frames"] + bus["overflow"] - before["frames"]) == sent

    assert service.status_when(all_accounted_for)["buses"]["radars"]["overflow"] > 0
