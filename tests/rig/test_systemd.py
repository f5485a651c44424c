"""The Debian package under a real systemd, from its installation to its purge: in this order, each test with the last one's service."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest

from echogrid.client import Client
from echogrid.core.map.tiled_map import LogOdds
from echogrid.store.stored_map import stored_map
from echogrid.store.tile_store import TileStore
from tests.rig import real_bus
from tests.support.places import ROOT

log = logging.getLogger("rig")
UNIT = "echogrid.service"
CONFIG = Path("/etc/echogrid/echogrid.toml")
STATE = Path("/var/lib/private/echogrid")  # where a DynamicUser's /var/lib/echogrid is
MAP = STATE / "map.egmap"
PORT = 7447
PATIENCE = 120.0  # s

if os.environ.get("RIG") not in ("guest", "here"):
    pytest.skip("'make test-rig' runs this under systemd; tests/watching/test_systemd.py covers the protocol", allow_module_level=True)


def done(*command: str) -> str:
    """What a command says. Raises where it fails, with that."""
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    assert result.returncode == 0, f"{' '.join(command)}: {result.returncode}: {result.stdout}"
    return result.stdout.strip()


def dpkg(*arguments: str) -> None:
    done("dpkg", "--force-unsafe-io", *arguments)  # which spares the waiting for a disk


def package() -> str:
    """The newest one that `make deb` left."""
    return str(max((ROOT / "dist").glob("echogrid_*.deb"), key=lambda path: path.stat().st_mtime))


def shown(name: str) -> str:
    """A property of the unit."""
    return done("systemctl", "show", "--property", name, "--value", UNIT)


def main_pid() -> int:
    return int(shown("MainPID"))


def journal() -> str:
    return done("journalctl", "--unit", UNIT, "--output", "cat", "--no-pager")


def eventually(what: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < deadline, f"{done('systemctl', 'show', UNIT)}\n{journal()}"
        time.sleep(0.2)


def restarted_after(act: Callable[[], object]) -> None:
    """Whether systemd brings the service back by itself after what is done to it."""
    before, restarts = main_pid(), int(shown("NRestarts"))
    act()
    eventually(lambda: int(shown("NRestarts")) > restarts and shown("SubState") == "running")
    assert main_pid() not in (0, before)


def running_epoch(client: Client) -> int:
    """Of the map that is being made, which is kept without fault."""
    status = client.status()
    assert status is not None
    assert status["store"]["state"] == "ok", status["store"]["reason"]
    return int(status["epoch"])


def whole(epoch: int) -> LogOdds:
    """What the file has of one of its maps."""
    with TileStore(MAP) as store:
        return stored_map(store, epoch).whole()[2]


@pytest.fixture(scope="module", autouse=True)
def _interfaces() -> Iterator[None]:
    with real_bus.interfaces():
        yield


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten seconds of the demo drive with the real interfaces' names, for canplayer."""
    path = tmp_path_factory.mktemp("drive") / "can.log"
    with can.Logger(path) as writer:
        for message in real_bus.drive(10.0):
            writer(message)
    return path


@pytest.fixture
def traffic(recording: Path) -> Iterator[None]:
    """The drive over and over, at the buses' pace."""
    with subprocess.Popen(["canplayer", "-l", "i", "-I", str(recording)]) as player:
        try:
            yield
        finally:
            player.kill()


def test_the_first_installation_starts_nothing() -> None:
    dpkg("--install", package())
    assert (shown("UnitFileState"), shown("ActiveState")) == ("disabled", "inactive")
    assert str(CONFIG) in done("dpkg-query", "--show", "--showformat=${Conffiles}", "echogrid")
    done("echogrid", "check", "--config", str(CONFIG))


def test_the_sandbox_as_systemd_judges_it() -> None:
    assert done("systemd-analyze", "verify", "--man=no", "--recursive-errors=yes", UNIT) == ""
    done("systemd-analyze", "security", "--threshold=15", UNIT)


def test_it_is_ready_when_its_buses_are_live() -> None:
    CONFIG.write_text(real_bus.configuration(PORT, model="default"))
    done("systemctl", "enable", "--now", UNIT)  # returns at READY=1
    assert (shown("ActiveState"), shown("SubState")) == ("active", "running")
    assert "live on chassis (socketcan rigcan0), radars (socketcan rigcan1)" in journal()
    assert shown("StatusText")
    assert "onnxruntime" not in journal()  # which misses nothing in the sandbox, and has no use to report to its makers


@pytest.mark.usefixtures("traffic")
def test_it_maps_and_says_so() -> None:
    with Client(f"tcp/127.0.0.1:{PORT}", real_bus.VEHICLE) as client:
        eventually(lambda: client.grid(timeout=2.0) is not None)
        eventually(lambda: shown("StatusText").startswith("ok; ") and "maps/s" in shown("StatusText"))
        status = client.status()
    assert status is not None
    assert {name: bus["overflow"] for name, bus in status["buses"].items()} == {"chassis": 0, "radars": 0}


def test_it_runs_as_nobody_in_particular() -> None:
    process = dict(line.split(":\t") for line in Path(f"/proc/{main_pid()}/status").read_text().splitlines() if ":\t" in line)
    assert int(process["Uid"].split()[0]) >= 61184  # systemd's range for dynamic users
    assert {process[name] for name in ("CapInh", "CapPrm", "CapEff", "CapBnd", "CapAmb")} == {"0" * 16}
    assert (process["NoNewPrivs"], process["Seccomp"]) == ("1", "2")


@pytest.mark.usefixtures("traffic")
def test_a_stop_is_clean_and_keeps_the_map() -> None:
    with Client(f"tcp/127.0.0.1:{PORT}", real_bus.VEHICLE) as client:
        eventually(lambda: client.grid(timeout=2.0) is not None)
        epoch = running_epoch(client)
    done("systemctl", "stop", UNIT)
    assert (shown("Result"), shown("ExecMainStatus")) == ("success", "0")  # not "timeout": TimeoutStopSec was enough
    log.info("stopped in %.2f s", (int(shown("InactiveEnterTimestampMonotonic")) - int(shown("ActiveExitTimestampMonotonic"))) / 1e6)
    assert not MAP.with_name("map.egmap-wal").exists()  # all is in one file
    assert (whole(epoch) > 1).sum() > 100
    done("systemctl", "start", UNIT)


def test_the_watchdog_restarts_a_frozen_service() -> None:
    restarted_after(lambda: os.kill(main_pid(), signal.SIGSTOP))
    assert "Watchdog timeout" in journal()


@pytest.mark.usefixtures("traffic")
def test_kill_9_loses_no_stored_map() -> None:
    """Neither an older map nor what has been written of the running one; the next one has another number."""
    with Client(f"tcp/127.0.0.1:{PORT}", real_bus.VEHICLE) as client:
        epoch = running_epoch(client)
        with TileStore(MAP) as store:
            older = store.numbers()[-2]
        before = whole(older)

        def written() -> bool:
            status = client.status()
            return status is not None and status["store"]["written"] > 0

        eventually(written)
        restarted_after(lambda: os.kill(main_pid(), signal.SIGKILL))
        eventually(lambda: client.grid(timeout=2.0) is not None)  # the same client finds the new service
        eventually(lambda: running_epoch(client) > epoch)
    np.testing.assert_array_equal(whole(older), before)
    assert (whole(epoch) > 1).sum() > 100


def test_memory_and_processor_are_limited() -> None:
    assert (shown("MemoryMax"), shown("CPUQuotaPerSecUSec"), shown("TasksMax")) == (str(768 << 20), "1s", "128")
    group = Path("/sys/fs/cgroup") / shown("ControlGroup").lstrip("/")
    assert (group / "memory.max").read_text().strip() == str(768 << 20)
    assert (group / "cpu.max").read_text().split() == ["100000", "100000"]
    peak = group / "memory.peak"  # since Linux 5.19
    used = int(peak.read_text()) if peak.exists() else int(shown("MemoryCurrent"))
    log.info("%d MiB of memory at most, %s threads", used >> 20, shown("TasksCurrent"))
    assert 0 < used < 768 << 20

    def starve() -> None:
        done("systemctl", "set-property", "--runtime", UNIT, "MemoryMax=16M")

    try:
        before = int(shown("NRestarts"))
        starve()
        eventually(lambda: "oom-kill" in journal() and int(shown("NRestarts")) > before)
    finally:
        done("systemctl", "set-property", "--runtime", UNIT, f"MemoryMax={768 << 20}")
    eventually(lambda: shown("SubState") == "running")


def test_a_reload_takes_over_what_is_safe_and_refuses_the_rest() -> None:
    before = main_pid()
    text = CONFIG.read_text()
    CONFIG.write_text(f"{text}rate_hz = 5\n")  # [publish] is the last table
    done("systemctl", "reload", UNIT)
    eventually(lambda: "was read again" in journal())
    CONFIG.write_text(text.replace(real_bus.VEHICLE, "another-car"))
    done("systemctl", "reload", UNIT)
    eventually(lambda: "not reloaded" in journal() and "vehicle: only rate_hz" in journal())
    CONFIG.write_text(text)
    assert (main_pid(), shown("SubState")) == (before, "running")


def test_an_upgrade_restarts_it_with_its_own_configuration() -> None:
    before, text = main_pid(), CONFIG.read_text()
    dpkg("--install", package())
    assert (shown("SubState"), CONFIG.read_text()) == ("running", text)
    assert main_pid() != before


def test_what_removal_and_purge_leave() -> None:
    dpkg("--remove", "echogrid")
    assert shown("LoadState") == "not-found"
    assert CONFIG.exists()
    assert MAP.exists()
    dpkg("--purge", "echogrid")
    assert not CONFIG.exists()
    assert not STATE.exists()
    assert not Path("/usr/lib/echogrid").exists()


def test_networkd_understands_the_interface_files() -> None:
    """vcan0 comes up as its file says, and no line of any file is complained of."""
    folder = Path("/etc/systemd/network")
    files = sorted((ROOT / "deploy" / "network").iterdir())
    try:
        for file in files:
            shutil.copy(file, folder)
        done("systemctl", "restart", "systemd-networkd")
        eventually(lambda: Path("/sys/class/net/vcan0/mtu").exists())
        assert Path("/sys/class/net/vcan0/mtu").read_text().strip() == "72"
        eventually(lambda: int(Path("/sys/class/net/vcan0/flags").read_text(), 16) & 1 == 1)  # IFF_UP
        said = done("journalctl", "--unit", "systemd-networkd", "--output", "cat", "--no-pager")
        said += subprocess.run(
            ["udevadm", "test-builtin", "net_setup_link", "/sys/class/net/vcan0"], capture_output=True, text=True, check=False
        ).stderr
        assert [
            line
            for line in said.splitlines()
            for file in files
            if file.name in line and any(word in line for word in ("nvalid", "nknown", "ailed"))
        ] == []
    finally:
        for file in files:
            (folder / file.name).unlink(missing_ok=True)
        subprocess.run(["ip", "link", "delete", "dev", "vcan0"], capture_output=True, check=False)
