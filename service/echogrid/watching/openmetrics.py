"""The service's status as OpenMetrics: every whole number in it is a counter. docs/watching.md lists them. Needs the extra `metrics`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any
from wsgiref.simple_server import WSGIRequestHandler

from prometheus_client import CollectorRegistry, generate_latest, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric, StateSetMetricFamily

from echogrid import __version__
from echogrid.core.motion import map_frame
from echogrid.recording import mcap_recorder
from echogrid.store import store_file
from echogrid.topics.diagnostics import LEVELS

OTHERS = {"store": store_file.STATES, "recording": mcap_recorder.STATES, "pose": map_frame.STATES}  # each if configured
IDLE = 10.0  # s: who asks for nothing so long is hung up on, and has no thread any more
Tables = Mapping[tuple[str, ...], Mapping[str, Any]]  # label values -> a part's numbers


class Exposition:
    """Remembers the newest status and shows it as metrics; nothing before the first."""

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle
        self._newest: tuple[Mapping[str, Any], float] | None = None
        self._registry = CollectorRegistry()
        self._registry.register(self)

    def update(self, status: Mapping[str, Any], taken_at: float) -> None:
        """`taken_at`: Unix time in s."""
        self._newest = (status, taken_at)

    def collect(self) -> Iterable[Metric]:
        """What prometheus-client asks for at each look."""
        return () if self._newest is None else families(self._newest[0], self._vehicle, self._newest[1])

    def serve(self, host: str, port: int) -> Callable[[], None]:
        """Answers HTTP requests in threads of its own until the returned function is called. Raises OSError."""
        server, thread = start_http_server(port, host, self._registry)
        server.RequestHandlerClass = _Handler

        def close() -> None:
            server.shutdown()
            server.server_close()
            thread.join()

        return close

    def write(self, path: str) -> None:
        """Replaces the file as a whole, in the text format that node_exporter reads. Raises OSError."""
        partial = Path(path).with_name(f".{Path(path).name}.partial")  # the same each time: kills do not leave ever more of them
        try:
            partial.write_bytes(generate_latest(self._registry))
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)


class _Handler(WSGIRequestHandler):
    """Logs no requests, and waits no longer than IDLE for one."""

    timeout = IDLE

    def handle(self) -> None:
        with suppress(TimeoutError):
            super().handle()

    def log_message(self, *_: object) -> None:
        pass


def families(status: Mapping[str, Any], vehicle: str, taken_at: float) -> Iterator[Metric]:
    """All metrics of a status that was taken at `taken_at`, Unix time in s."""
    state = StateSetMetricFamily("echogrid_state", "State of the map.", labels=["vehicle"])
    state.add_metric([vehicle], {name: name == status["state"] for name in LEVELS})
    yield state
    info = InfoMetricFamily("echogrid_build", "Version of the service, and which sensor model it runs and why.", labels=["vehicle"])
    info.add_metric([vehicle], {"version": __version__, "model": status["model"]})
    yield info
    yield _gauge("status_timestamp", "seconds", "When the status was taken, Unix time.", vehicle, taken_at)
    yield _gauge("map_rate", "hertz", "Map updates per second.", vehicle, status["rates"]["map_hz"])
    yield _gauge("frame_rate", "hertz", "CAN frames received per second.", vehicle, status["rates"]["frames_hz"])
    yield _gauge("resident_memory", "bytes", "Memory of the service in RAM.", vehicle, status["rss_mib"] * 2**20)
    for name, states in OTHERS.items():
        other = status[name]
        if other is not None:
            how = StateSetMetricFamily(f"echogrid_{name}_state", f"State of the {name}.", labels=["vehicle"])
            how.add_metric([vehicle], {each: each == other["state"] for each in states})
            yield how
            if "mib" in other:
                yield _gauge(f"{name}_size", "bytes", f"Size of the {name}'s file.", vehicle, other["mib"] * 2**20)
            yield from _counters(f"echogrid_{name}", ["vehicle"], {(vehicle,): other})
    latency = Metric("echogrid_latency", "From a frame's receipt to its map update.", "summary", "seconds")
    for quantile, key in (("0.5", "p50"), ("0.99", "p99")):
        if status["latency_ms"][key] is not None:  # before the first map
            latency.add_sample(latency.name, {"vehicle": vehicle, "quantile": quantile}, status["latency_ms"][key] / 1e3)
    yield latency
    yield from _counters("echogrid", ["vehicle"], {(vehicle,): status})
    radars: Tables = {(vehicle, name): radar for name, radar in status["sensors"].items()}
    buses: Tables = {(vehicle, name): bus for name, bus in status["buses"].items()}
    yield from _counters("echogrid_radar", ["vehicle", "radar"], radars)
    yield from _counters("echogrid_bus", ["vehicle", "bus"], buses)
    up = GaugeMetricFamily("echogrid_bus_up", "1 if the bus is open and had no fault since its last frame.", labels=["vehicle", "bus"])
    for labels, bus in buses.items():
        up.add_metric(labels, bus["up"])
    yield up


def _gauge(name: str, unit: str, what: str, vehicle: str, value: float) -> Metric:
    gauge = GaugeMetricFamily(f"echogrid_{name}", what, labels=["vehicle"], unit=unit)
    gauge.add_metric([vehicle], value)
    return gauge


def _counters(prefix: str, labels: list[str], tables: Tables) -> Iterator[Metric]:
    """One family for each whole number of the tables, with a sample for each table's labels."""
    found: dict[str, CounterMetricFamily] = {}
    for values, table in tables.items():
        for key, count in table.items():
            if type(count) is int:  # no bool
                family = found.setdefault(
                    key, CounterMetricFamily(f"{prefix}_{key}", f"'{key}' of the status, since the start.", labels=labels)
                )
                family.add_metric(values, count)
    yield from found.values()
