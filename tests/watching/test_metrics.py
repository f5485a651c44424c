"""Metrics over HTTP and in a file, read by prometheus-client's own parsers."""

from __future__ import annotations

import logging
import re
import socket
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from prometheus_client import Metric
from prometheus_client.openmetrics.parser import text_string_to_metric_families as read_openmetrics
from prometheus_client.parser import text_string_to_metric_families as read_text
from tests.support import world
from tests.support.places import ROOT
from tests.support.status import status
from tests.support.waiting import PATIENCE, until

from echogrid import __version__
from echogrid.config.loading import load_config
from echogrid.config.tables import Metrics as Settings
from echogrid.errors import EchogridError
from echogrid.watching import openmetrics
from echogrid.watching.metrics import Metrics

Samples = dict[tuple[str, frozenset[tuple[str, str]]], float]


@pytest.fixture
def address(port: int) -> str:
    return f"127.0.0.1:{port}"


def scrape(address: str) -> str:
    """As Prometheus asks."""
    request = urllib.request.Request(f"http://{address}/metrics", headers={"Accept": "application/openmetrics-text; version=1.0.0"})
    with urllib.request.urlopen(request, timeout=PATIENCE) as response:
        assert response.headers["Content-Type"].startswith("application/openmetrics-text")
        return response.read().decode()


def samples(families: Iterable[Metric]) -> Samples:
    return {(sample.name, frozenset(sample.labels.items())): sample.value for family in families for sample in family.samples}


def sample(name: str, **labels: str) -> tuple[str, frozenset[tuple[str, str]]]:
    return (name, frozenset({"vehicle": "car", **labels}.items()))


def whole_numbers(of: dict[str, Any]) -> Iterator[int]:
    """All of them at any depth; a bool is none."""
    for value in of.values():
        if isinstance(value, dict):
            yield from whole_numbers(value)
        elif isinstance(value, int) and not isinstance(value, bool):
            yield value


def test_the_endpoint_shows_the_newest_status(address: str) -> None:
    sent = status("degraded", "radar rear_right: silent for 1.2 s")
    with Metrics(Settings(listen=address), "car") as metrics:
        assert list(read_openmetrics(scrape(address))) == []
        metrics.update(status())
        metrics.update(sent)
        families = list(read_openmetrics(scrape(address)))
    found = samples(families)
    assert {labels for (name, labels), value in found.items() if name == "echogrid_state" and value} == {
        frozenset({("vehicle", "car"), ("echogrid_state", "degraded")})
    }
    assert sum(name == "echogrid_state" for name, _ in found) == 5
    assert found[sample("echogrid_build_info", version=__version__, model=sent["model"])] == 1
    assert found[sample("echogrid_map_rate_hertz")] == 19.5
    assert found[sample("echogrid_frame_rate_hertz")] == 4120.25
    assert found[sample("echogrid_latency_seconds", quantile="0.5")] == 0.0125
    assert found[sample("echogrid_latency_seconds", quantile="0.99")] == 0.03125
    assert found[sample("echogrid_resident_memory_bytes")] == 143.5 * 1024 * 1024
    assert found[sample("echogrid_status_timestamp_seconds")] > 1.7e9
    assert found[sample("echogrid_frames_total")] == sent["frames"]
    assert found[sample("echogrid_radar_complete_total", radar="rear_right")] == sent["sensors"]["rear_right"]["complete"]
    assert found[sample("echogrid_bus_overflow_total", bus="radars")] == sent["buses"]["radars"]["overflow"]
    assert (found[sample("echogrid_bus_up", bus="chassis")], found[sample("echogrid_bus_up", bus="radars")]) == (1, 0)
    assert found[sample("echogrid_store_size_bytes")] == 12.5 * 1024 * 1024
    assert found[sample("echogrid_store_state", echogrid_store_state="ok")] == 1
    counted = sorted(value for (name, _), value in found.items() if name.endswith("_total"))
    assert counted == sorted(whole_numbers(sent))
    assert all(family.documentation for family in families)


def test_who_connects_and_asks_nothing_keeps_no_thread(
    address: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Monitoring that loses its network leaves such connections, and a service under systemd has 128 threads."""
    monkeypatch.setattr(openmetrics._Handler, "timeout", 0.1)
    host, port = address.split(":")
    with Metrics(Settings(listen=address), "car") as metrics, ExitStack() as opened:
        metrics.update(status())
        before = threading.active_count()
        held = [opened.enter_context(socket.create_connection((host, int(port)), PATIENCE)) for _ in range(5)]
        assert all(one.recv(1) == b"" for one in held)  # hung up on
        until(lambda: threading.active_count() <= before)
        assert scrape(address)
    assert capfd.readouterr().err == ""


def test_a_file_that_one_who_was_killed_left_is_taken_away(tmp_path: Path) -> None:
    (tmp_path / ".echogrid.prom.partial").write_text("half")
    path = tmp_path / "echogrid.prom"
    with Metrics(Settings(file=str(path)), "car") as metrics:
        metrics.update(status())
        assert list(tmp_path.iterdir()) == [path]


def test_the_file_holds_the_same(tmp_path: Path, address: str) -> None:
    path = tmp_path / "echogrid.prom"
    with Metrics(Settings(listen=address, file=str(path)), "car") as metrics:
        metrics.update(status("stale", "no radar frame for 3 s"))
        served = samples(read_openmetrics(scrape(address)))
    assert samples(read_text(path.read_text())) == served
    assert list(tmp_path.iterdir()) == [path]


def test_a_reader_never_sees_half_a_file(tmp_path: Path) -> None:
    path = tmp_path / "echogrid.prom"
    done = threading.Event()
    with Metrics(Settings(file=str(path)), "car") as metrics:
        metrics.update(status())
        writer = threading.Thread(target=lambda: ([metrics.update(status()) for _ in range(50)], done.set()))
        writer.start()
        try:
            while not done.is_set():
                assert sample("echogrid_bus_up", bus="radars") in samples(read_text(path.read_text()))  # the last line
        finally:
            writer.join()


def test_before_the_first_map_there_is_no_latency(address: str) -> None:
    with Metrics(Settings(listen=address), "car") as metrics:
        metrics.update({**status(), "latency_ms": {"p50": None, "p99": None}})
        assert not any(name == "echogrid_latency_seconds" for name, _ in samples(read_openmetrics(scrape(address))))


def test_the_port_is_free_again_afterwards(address: str) -> None:
    for _ in range(2):
        with Metrics(Settings(listen=address), "car") as metrics:
            metrics.update(status())
            assert scrape(address)
    with pytest.raises(OSError, match="refused"):
        scrape(address)


def test_a_taken_address_is_one_sentence(address: str) -> None:
    with (
        Metrics(Settings(listen=address), "car"),
        pytest.raises(EchogridError, match=rf"^metrics.listen: '{address}' cannot be listened on: Address already in use$"),
    ):
        Metrics(Settings(listen=address), "car")


def test_a_file_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "none" / "echogrid.prom"
    with pytest.raises(EchogridError, match=rf"^metrics.file: '{path}' cannot be written: No such file or directory$"):
        Metrics(Settings(file=str(path)), "car")


def test_a_file_that_cannot_be_written_any_more_is_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "run" / "echogrid.prom"
    path.parent.mkdir()
    with Metrics(Settings(file=str(path)), "car") as metrics:
        path.unlink()
        path.parent.rmdir()
        with caplog.at_level(logging.WARNING):
            metrics.update(status())
        assert "cannot be written: No such file or directory" in caplog.text
        path.parent.mkdir()
        metrics.update(status())
        assert path.is_file()


def run(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=PATIENCE)
    return done.stdout.strip()


BLOCKED = """
import os, sys
sys.modules["prometheus_client"] = None
from echogrid.config.tables import Metrics as Settings
from echogrid.errors import EchogridError
from echogrid.watching.metrics import Metrics
"""


def test_without_the_extra_it_is_said_what_to_install(address: str) -> None:
    code = f"try: Metrics(Settings(listen={address!r}), 'car')\nexcept EchogridError as error: print(error)"
    assert run(BLOCKED + code) == "metrics: prometheus-client is not installed: pip install prometheus-client"


def test_by_default_nothing_is_opened_and_the_extra_is_not_needed() -> None:
    code = "before = os.listdir('/proc/self/fd')\nwith Metrics(Settings(), 'car') as metrics:\n    metrics.update({})\n"
    assert run(BLOCKED + code + "    print(os.listdir('/proc/self/fd') == before)") == "True"


@pytest.mark.parametrize("listen", ["127.0.0.1:9464", "[::1]:9464", "localhost:1"])
def test_addresses(listen: str) -> None:
    host, port = listen.rsplit(":", 1)
    assert Settings(listen=listen).address() == (host.strip("[]"), int(port))


@pytest.mark.parametrize(
    "listen", ["9464", ":9464", "127.0.0.1", "127.0.0.1:", "127.0.0.1:http", "a:65536", "a:0", "a:1/b", "u@a:1", "[::1:1"]
)
def test_an_address_that_cannot_be_is_one_sentence(tmp_path: Path, listen: str) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(world.CONFIG + f'\n[metrics]\nlisten = "{listen}"\n')
    with pytest.raises(
        EchogridError, match=rf"^{path}: metrics.listen: '{re.escape(listen)}' found, expected an address and a port such as"
    ):
        load_config(path)


@pytest.mark.parametrize("file", ["metrics.prom", "/run/echogrid/metrics.txt"])
def test_a_file_that_node_exporter_would_not_read_is_one_sentence(tmp_path: Path, file: str) -> None:
    path = tmp_path / "echogrid.toml"
    path.write_text(world.CONFIG + f'\n[metrics]\nfile = "{file}"\n')
    with pytest.raises(EchogridError, match=rf"^{path}: metrics.file: '{file}' found, expected an absolute path that ends in .prom"):
        load_config(path)


def test_the_services_own_status_makes_metrics_and_all_are_documented(tmp_path: Path) -> None:
    from echogrid.live.service import Service
    from echogrid.pipeline import Pipeline

    path, out = tmp_path / "echogrid.toml", tmp_path / "echogrid.prom"
    path.write_text(world.CONFIG)
    with Metrics(Settings(file=str(out)), "car") as metrics:
        metrics.update({**Service(Pipeline(load_config(path), path)).status(), "buses": status()["buses"]})
    names = {name for name, _ in samples(read_text(out.read_text()))}
    assert {"echogrid_state", "echogrid_frames_total", "echogrid_radar_late_total", "echogrid_bus_up"} <= names
    text = (ROOT / "docs" / "watching.md").read_text()
    assert {name for name in names if f"`{name}`" not in text} == set()
