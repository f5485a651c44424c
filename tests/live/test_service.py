"""The running service: buses in, Zenoh out, and what it must not import."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from itertools import takewhile
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import zenoh
from PIL import Image
from tests.support import world
from tests.support.places import DEMO
from tests.support.waiting import PATIENCE, until

from echogrid import __main__ as program
from echogrid.can.intake.frames import FrameBatch
from echogrid.client import Client
from echogrid.commands.demo import demo
from echogrid.commands.replay import replay
from echogrid.config.loading import load_config, remarks
from echogrid.core.radar import doppler_errors
from echogrid.errors import EchogridError
from echogrid.live import publishing
from echogrid.live.player import Player, on_virtual_buses
from echogrid.live.service import Service
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.store.learned_file import car_of, recall
from echogrid.topics.topic import META
from echogrid.zenoh.publisher import key, session_config


def begin_of(drive: Path, out: Path, seconds: float) -> Path:
    """A drive folder with the first seconds of another."""
    shutil.copytree(drive, out, ignore=shutil.ignore_patterns("can.log.gz"))
    with gzip.open(drive / "can.log.gz", "rt") as log, (out / "can.log").open("w") as kept:
        times = ((line, float(line[1:].partition(")")[0])) for line in log)
        first, begun = next(times)
        kept.write(first)
        kept.writelines(line for line, _ in takewhile(lambda one: one[1] < begun + seconds, times))
    return out


def test_through_a_virtual_bus_the_map_is_that_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The demo's whole way: CAN bus, service threads, Zenoh, a subscriber in another process. Of the drive's first half minute."""
    drive = find_drive(begin_of(DEMO, tmp_path / "drive", 30.0), None)
    monkeypatch.setattr("echogrid.commands.demo.find_drive", lambda folder, config: drive)
    through_bus = demo(tmp_path / "bus")
    from_file = replay(drive, tmp_path / "file")
    assert through_bus["map_sha256"] == from_file["map_sha256"]
    assert through_bus["cycles"] == from_file["cycles"] > 500
    assert (tmp_path / "bus" / "received.png").is_file()
    with Image.open(tmp_path / "bus" / "side_by_side.png") as sheet:
        assert min(sheet.size) > 400
    with np.load(tmp_path / "bus" / "map.npz") as file:
        assert (file["log_odds"] > 1).sum() > 1000


def test_at_its_own_pace_few_looks_at_the_bus_give_the_map_of_the_file(tmp_path: Path, port: int) -> None:
    """However slow the machine is: then a look finds more."""
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 60)])
    publish = f'\n[publish]\nlisten = ["tcp/127.0.0.1:{port}"]\n'
    drive = world.write_drive(tmp_path, world.record(world.straight(5.0), [wall], 4.0), world.CONFIG + publish)
    path = drive / "echogrid.toml"
    config = on_virtual_buses(load_config(path, "analytic"))
    service, file = Service(Pipeline(config, path)), Pipeline(config, path)
    looks, put = list[int](), service.receiving.queue.put

    def noted(bus: str, batch: FrameBatch, read_at: float) -> None:
        looks.append(len(batch))
        put(bus, batch, read_at)

    service.receiving.queue.put = noted  # type: ignore[method-assign]
    player = Player(service, Log(drive / "can.log"), speed=1.0)
    service.workers.add("player", player.run)
    service.run()
    cycles = sum(1 for _ in file.updates(Log(drive / "can.log").batches()))
    assert service.pipeline.health.cycles == cycles > 70
    for live, kept in zip(service.pipeline.mapper.map.whole(), file.mapper.map.whole(), strict=True):
        np.testing.assert_array_equal(live, kept)
    assert sum(looks) == player.sent
    assert len(looks) < 4 * cycles


def test_what_is_kept_includes_what_the_last_cycle_teaches(tmp_path: Path, port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit what the file teaches, each of whose cycles says something."""
    monkeypatch.setattr(doppler_errors, "PERIOD_NS", 0)
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 60)])
    tables = f'\n[publish]\nlisten = ["tcp/127.0.0.1:{port}"]\n[store]\npath = "map.egmap"\n'
    messages = world.record(world.straight(5.0), [wall], 1.0)
    while messages[-1].arbitration_id != 0x300:  # a header, which says nothing yet, but if it comes late the cycle's time is up
        messages.pop()
    messages[-1].timestamp += 0.1
    drive = world.write_drive(tmp_path, messages, world.CONFIG + tables)
    path = drive / "echogrid.toml"
    config = on_virtual_buses(load_config(path, "analytic"))
    service, mapper = Service(Pipeline(config, path)), (file := Pipeline(config, path)).mapper
    service.workers.add("player", Player(service, Log(drive / "can.log"), speed=1.0).run)
    service.run()
    cycles = sum(1 for _ in file.updates(Log(drive / "can.log").batches()))
    before = mapper.odometry.errors.keep()
    mapper.learn()
    taught = mapper.odometry.errors.keep()
    kept = recall(tmp_path / "map.learned.json", car_of(config), len(taught.mean))
    assert kept is not None
    assert service.pipeline.health.cycles == cycles > 10
    assert not np.array_equal(taught.covariance, before.covariance)
    np.testing.assert_array_equal(kept.mean, taught.mean)
    np.testing.assert_array_equal(kept.covariance, taught.covariance)


def test_nothing_in_the_service_imports_torch_or_the_training_package() -> None:
    code = (
        "import importlib, pkgutil, sys, echogrid\n"
        "for module in pkgutil.walk_packages(echogrid.__path__, 'echogrid.'):\n"
        "    if not module.name.endswith('__main__'): importlib.import_module(module.name)\n"
        "print(sorted(name for name in sys.modules if name.split('.')[0] in ('torch', 'echogrid_training')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE)
    assert done.stdout.strip() == "[]"


def test_the_analytic_model_needs_no_onnxruntime(config: tuple[Path, int]) -> None:
    """52 MiB that a small computer may not have to spare."""
    path, _ = config
    code = (
        "import sys; from pathlib import Path; from echogrid.live import service; from echogrid.config.loading import load_config\n"
        f"path = Path({str(path)!r}); service.Pipeline(load_config(path), path); print('onnxruntime' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE)
    assert done.stdout.strip() == "False"


@pytest.fixture
def config(tmp_path: Path, port: int) -> tuple[Path, int]:
    """A service on a UDP-multicast-free, in-process bus: alive, but without traffic."""
    path = tmp_path / "echogrid.toml"
    path.write_text(world.CONFIG + f'\n[publish]\nlisten = ["tcp/127.0.0.1:{port}"]\n')
    return path, port


def test_meta_is_said_again(config: tuple[Path, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Not all who come later are given the last one: see docs/interface.md. This subscriber asks for nothing that was."""
    path, port = config
    monkeypatch.setattr(publishing, "META_PERIOD", 0.2)
    service = Service(Pipeline(load_config(path), path))
    running = threading.Thread(target=service.run)
    running.start()
    try:
        with zenoh.open(session_config((), (f"tcp/127.0.0.1:{port}",), sends=False)) as session:
            said = session.declare_subscriber(key("*", META.name))
            for _ in range(3):
                assert json.loads(bytes(said.recv().payload))["frames"] == {"map": "odom", "car": "base"}
    finally:
        service.workers.stop.set()
        running.join()


def test_a_clock_beyond_ros_stamps_is_one_sentence(config: tuple[Path, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer whose clock ran out of battery says any year."""
    path, _ = config
    monkeypatch.setattr(publishing, "time", SimpleNamespace(time_ns=lambda: 2**31 * 10**9, monotonic=time.monotonic))
    with pytest.raises(EchogridError, match=r"the clock says 2147483648\.000 s since 1970, .* set the clock"):
        Service(Pipeline(load_config(path), path)).run()


def test_run_says_that_it_waits_and_ends_cleanly_on_a_signal(config: tuple[Path, int]) -> None:
    path, port = config
    command = [sys.executable, "-W", "error", "-m", "echogrid", "run", "-c", str(path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as service:
        with Client(f"tcp/127.0.0.1:{port}", "test") as client:
            status = client.status(PATIENCE)
            assert status is not None
            assert status["state"] == "stale"
            assert status["buses"]["can0"] == {"frames": 0, "errors": 0, "bus_off": 0, "overflow": 0, "reconnects": 0, "up": True}
            assert set(status["sensors"]) == set(world.RADARS)
            until(client.alive)
        os.kill(service.pid, signal.SIGTERM)
        _, errors = service.communicate(timeout=PATIENCE)
    assert service.returncode == 0
    assert "Traceback" not in errors
    assert "stopped after 0 cycles" in errors


def test_a_bus_that_is_not_there_is_one_sentence(tmp_path: Path, config: tuple[Path, int]) -> None:
    path, _ = config
    text = path.read_text().replace('interface = "virtual"', 'interface = "socketcan"').replace('channel = "can0"', 'channel = "can97"')
    path.write_text(text)
    command = [sys.executable, "-m", "echogrid", "run", "-c", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    assert lines[-1].startswith(f"echogrid: {path}: bus 'can0': socketcan channel 'can97' cannot be opened: ")
    assert "Traceback" not in done.stderr


def test_a_bus_that_nothing_is_on_is_not_opened_and_that_is_said(config: tuple[Path, int], caplog: pytest.LogCaptureFixture) -> None:
    """Not even where it could not be: its frames would all have been received, for there is nothing to select on."""
    path, _ = config
    path.write_text(path.read_text() + '\n[[bus]]\nname = "body"\nchannel = "can97"\n')
    service = Service(Pipeline(load_config(path), path))
    running = threading.Thread(target=service.run)
    running.start()
    try:
        until(service.live.is_set)
        assert list(service.status()["buses"]) == ["can0"]
    finally:
        service.workers.stop.set()
        running.join()
    assert [message for message in caplog.messages if "body" in message] == remarks(service.config)


def test_status_is_json(config: tuple[Path, int]) -> None:
    from echogrid.config.loading import load_config
    from echogrid.live.service import Service
    from echogrid.pipeline import Pipeline

    path, _ = config
    status = json.loads(json.dumps(Service(Pipeline(load_config(path), path)).status()))
    assert (status["state"], status["model"]) == ("stale", "the analytic model, as configured")


def test_on_sighup_it_takes_over_what_can_change_and_refuses_the_rest(config: tuple[Path, int]) -> None:
    path, port = config
    before = path.read_text()
    command = [sys.executable, "-m", "echogrid", "run", "-c", str(path)]
    said: list[str] = []
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as service:
        assert service.stderr is not None
        with Client(f"tcp/127.0.0.1:{port}", "test") as client:
            assert client.status(PATIENCE) is not None
            for text in (before + "rate_hz = 5.0\n", before.replace('channel = "can0"', 'channel = "can1"'), "vehicle = 3"):
                path.write_text(text)
                os.kill(service.pid, signal.SIGHUP)
                while not said or ("read again" not in said[-1] and "not reloaded" not in said[-1]):
                    said.append(service.stderr.readline())
                said.append("")
            assert client.status(PATIENCE) is not None
        service.terminate()
        assert service.wait(PATIENCE) == 0
    told = [line for line in said if "reload" in line or "read again" in line]
    assert "rate_hz=5.0" in told[0]
    assert "bus: only rate_hz and window_cells of [publish] can change without a restart" in told[1]
    assert "not reloaded" in told[2]
    assert "vehicle" in told[2]


class Loading(ModuleType):
    """The rest of the program while it is being imported: `hears` is called then."""

    def __init__(self, hears: Callable[[], None]) -> None:
        super().__init__("echogrid.cli")
        self.hears = hears

    def __getattr__(self, name: str) -> object:
        if name != "main":
            raise AttributeError(name)
        self.hears()
        return lambda: None


@pytest.fixture
def usual_signals() -> Iterator[dict[signal.Signals, object]]:
    usual = {number: signal.getsignal(number) for number in (signal.SIGHUP, signal.SIGTERM, signal.SIGINT)}
    yield dict(usual)
    for number, handler in usual.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("before", ["", "--log-level error ", "--log-level=error "])
def test_signals_while_it_loads(monkeypatch: pytest.MonkeyPatch, usual_signals: dict[signal.Signals, object], before: str) -> None:
    """A reload that comes early ends nothing, and a stop is heard, by a container's first process too."""
    monkeypatch.setattr(os, "_exit", sys.exit)
    monkeypatch.setattr(sys, "argv", ["echogrid", *f"{before}run -c echogrid.toml".split()])

    def hears() -> None:
        os.kill(os.getpid(), signal.SIGHUP)
        assert callable(signal.getsignal(signal.SIGTERM))
        os.kill(os.getpid(), signal.SIGTERM)
        raise AssertionError("it went on")

    monkeypatch.setitem(sys.modules, "echogrid.cli", Loading(hears))
    with pytest.raises(SystemExit) as ended:
        program.run()
    assert not ended.value.code


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(("words", "code"), [("replay run", 130), ("replay run --publish", 0), ("view", 0)])
def test_ctrl_c_and_sigterm_end_another_command_while_it_loads(
    monkeypatch: pytest.MonkeyPatch, usual_signals: dict[signal.Signals, object], number: signal.Signals, words: str, code: int
) -> None:
    monkeypatch.setattr(sys, "argv", ["echogrid", *words.split()])

    def hears() -> None:
        assert signal.getsignal(signal.SIGHUP) == usual_signals[signal.SIGHUP]
        os.kill(os.getpid(), number)
        raise AssertionError("it went on")

    monkeypatch.setitem(sys.modules, "echogrid.cli", Loading(hears))
    with pytest.raises(SystemExit) as ended:
        program.run()
    assert ended.value.code == code


def test_the_last_status_says_that_it_stopped(config: tuple[Path, int]) -> None:
    path, port = config
    command = [sys.executable, "-m", "echogrid", "run", "-c", str(path)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as service, Client(f"tcp/127.0.0.1:{port}", "test") as client:
        assert client.status(PATIENCE) is not None
        service.terminate()
        until(lambda: (status := client.status(0.05)) is not None and status["state"] == "stopped")
        assert service.wait(PATIENCE) == 0
        assert client.status(0.2) is None


def test_systemd_hears_ready_rates_watchdog_and_the_end(config: tuple[Path, int], tmp_path: Path) -> None:
    path, _ = config
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE)
        environment = os.environ | {"NOTIFY_SOCKET": str(tmp_path / "notify"), "STATE_DIRECTORY": str(tmp_path)}
        command = [sys.executable, "-m", "echogrid", "run", "-c", str(path)]
        with subprocess.Popen(command, stderr=subprocess.DEVNULL, env=environment) as service:
            heard = [manager.recv(4096).decode() for _ in range(4)]
            service.terminate()
            while heard[-1] != "STOPPING=1":
                heard.append(manager.recv(4096).decode())
            assert service.wait(PATIENCE) == 0
    assert heard[0] == "READY=1\nSTATUS=live on can0 (virtual can0); no map yet"
    assert "WATCHDOG=1" in heard  # a bus without traffic is no fault of the service
    assert any(line.startswith("STATUS=stale; 0.0 maps/s") for line in heard)
