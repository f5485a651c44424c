"""The client and the publisher, over loopback: in this process and in others."""

from __future__ import annotations

import math
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest
import zenoh

from echogrid.client import Client, Grid, Pose
from echogrid.config import Publish
from echogrid.core.occupancy import OccupancyMap
from echogrid.core.odometry import EgoState
from echogrid.core.raster import GridSpec
from echogrid.core.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.io import cdr
from echogrid.io.diagnostics import diagnostics
from echogrid.io.publisher import Publisher, session_config
from tests.status import status as a_status

PATIENCE = 10.0  # s: far beyond what anything here takes
LOG_ODDS = np.array([[0, 3.5, -3.5], [1, 0, 0]], dtype=np.float32)

T = TypeVar("T")


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def publish(endpoint: str, vehicle: str = "car") -> Publisher:
    return Publisher(Publish(listen=(endpoint,)), vehicle)


def until(read: Callable[[], T | None], send: Callable[[], object] = lambda: None) -> T:
    """What `read` returns in the end; sends before each try, for a subscription takes a moment to be known."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        send()
        value = read()
        if value is not None:
            return value
        time.sleep(0.002)
    raise AssertionError("nothing came")


def test_a_late_joiner_gets_the_last_map_at_once(endpoint: str) -> None:
    with publish(endpoint) as publisher:
        publisher.grid(1, 0, 0, 0.5, -LOG_ODDS)
        publisher.grid(123_456_789_012, -3, 10, 0.5, LOG_ODDS)
        with Client(endpoint) as client:
            grid = client.grid(PATIENCE)
            assert isinstance(grid, Grid)
            assert client.grid(0.0) is None
    assert (grid.stamp_ns, grid.frame, grid.cell, grid.origin) == (123_456_789_012, "odom", 0.5, (5.0, -1.5))
    np.testing.assert_array_equal(grid.occupancy, [[-1, 97, 3], [73, -1, -1]])
    np.testing.assert_allclose(grid.probability, [[np.nan, 0.97, 0.03], [0.73, np.nan, np.nan]], rtol=1e-6)
    assert client.malformed == 0


@pytest.mark.parametrize(("x", "y"), [(10.1, 4.4), (-7.3, 2.2), (3.7, -9.9), (-12.6, -1.2)])
def test_a_cell_is_found_where_it_lies(endpoint: str, x: float, y: float) -> None:
    """An obstacle seen from a car that has driven and turned is where it was: rows along y, columns along x."""
    spec = GridSpec(64, 0.5)
    occupancy = OccupancyMap(spec)
    odom_from_base = SE2(x - 2.0, y + 5.0, math.radians(90))  # in base, the obstacle is 5 m behind and 2 m to the right
    logits = np.full((64, 64), -1, dtype=np.float32)
    logits[32 - 5 : 32 - 3, 32 - 11 : 32 - 9] = 3
    occupancy.integrate(logits, odom_from_base)
    row, column, log_odds = occupancy.around(odom_from_base, 80)
    with publish(endpoint) as publisher, Client(endpoint) as client:
        publisher.grid(1, row, column, spec.cell, log_odds)
        grid = client.grid(PATIENCE)
    assert grid is not None
    i, j = int((y - grid.origin[1]) // grid.cell), int((x - grid.origin[0]) // grid.cell)
    assert grid.occupancy[i, j] > 90
    centre = np.argwhere(grid.occupancy > 60).mean(axis=0) + 0.5
    found = (grid.origin[0] + centre[1] * grid.cell, grid.origin[1] + centre[0] * grid.cell)
    assert found == pytest.approx((x, y), abs=grid.cell)


def test_odometry_status_and_diagnostics_arrive(endpoint: str) -> None:
    ego = EgoState(77, SE2(1.25, -2.5, 3 * math.pi), -1.5, 0.25)
    sent = diagnostics(a_status("degraded", "radar rear_right: late"), "car", 78)
    with publish(endpoint) as publisher, Client(endpoint) as client:
        pose = until(lambda: client.odometry(0.02), lambda: publisher.odometry(ego))
        status = until(lambda: client.status(0.02), lambda: publisher.status({"cycles": 3, "sensors": {"fl": {"late": 0}}}))
        received = until(lambda: client.diagnostics(0.02), lambda: publisher.diagnostics(sent))
    assert received == sent
    assert isinstance(pose, Pose)
    assert (pose.stamp_ns, pose.x, pose.y, pose.speed, pose.yaw_rate) == (77, 1.25, -2.5, -1.5, 0.25)
    assert abs(pose.yaw) == pytest.approx(math.pi)
    assert status == {"cycles": 3, "sensors": {"fl": {"late": 0}}}


def test_the_latest_wins(endpoint: str) -> None:
    with publish(endpoint) as publisher, Client(endpoint) as client:
        until(lambda: client.odometry(0.02), lambda: publisher.odometry(EgoState(1, SE2(0, 0, 0), 0, 0)))
        stamps = []
        for stamp_ns in range(100, 200):
            publisher.odometry(EgoState(stamp_ns, SE2(0, 0, 0), 0, 0))
        while not stamps or stamps[-1] < 199:
            pose = client.odometry(PATIENCE)
            assert pose is not None
            stamps.append(pose.stamp_ns)
            time.sleep(0.05)
    assert stamps == sorted(stamps)
    assert len(stamps) < 20


def test_none_when_the_time_is_over(endpoint: str) -> None:
    with publish(endpoint), Client(endpoint) as client:
        for read in (client.grid, client.odometry, client.status, client.diagnostics):
            started = time.monotonic()
            assert read(0.1) is None
            assert 0.1 <= time.monotonic() - started < 1.0


def test_alive_while_the_service_is(endpoint: str) -> None:
    publisher = publish(endpoint)
    try:
        with Client(endpoint) as client:
            until(lambda: client.alive() or None)
            publisher.close()
            until(lambda: None if client.alive() else True)
    finally:
        publisher.close()


def test_the_client_may_come_first_and_the_service_come_again(endpoint: str) -> None:
    with Client(endpoint) as client:
        assert not client.alive()
        assert client.grid(0.0) is None
        for stamp_ns in (1, 2):
            with publish(endpoint) as publisher:
                publisher.grid(stamp_ns, 0, 0, 0.5, LOG_ODDS)
                grid = client.grid(PATIENCE)
                assert grid is not None
                assert grid.stamp_ns == stamp_ns
                assert client.alive()


def test_one_vehicle_does_not_hear_another(endpoint: str) -> None:
    with publish(endpoint, "red-1") as publisher, Client(endpoint, "red-1") as red, Client(endpoint, "blue") as blue:
        publisher.grid(1, 0, 0, 0.5, LOG_ODDS)
        assert red.grid(PATIENCE) is not None
        assert red.alive()
        assert blue.grid(0.05) is None
        assert not blue.alive()


@pytest.mark.parametrize("vehicle", ["", "*", "**", "a/b", "a b", "car\n"])
def test_a_vehicle_that_cannot_be(vehicle: str) -> None:
    with pytest.raises(EchogridError, match=r"^vehicle: "):
        Client(vehicle=vehicle)


@pytest.mark.parametrize("address", ["", "127.0.0.1:7447", "carrier_pigeon/127.0.0.1:7447"])
def test_an_endpoint_that_cannot_be(address: str) -> None:
    with pytest.raises(EchogridError, match=rf"^endpoint: Zenoh refuses '{address}' \(.*\), expected an endpoint such as"):
        Client(address)


def test_malformed_payloads_are_counted_and_skipped(endpoint: str) -> None:
    good = {
        "grid/fused/full": cdr.encode_grid(cdr.Grid(5, "odom", 0.5, (0.0, 0.0), np.zeros((2, 2), dtype=np.int8))),
        "odom": cdr.encode_odometry(cdr.Odometry(5, "odom", "base", SE2(0, 0, 0), 0.0, 0.0)),
        "status": b'{"state": "running"}',
        "diagnostics": cdr.encode_diagnostics(cdr.DiagnosticArray(5, "", ())),
    }
    noise = (b"", b"\0", b"[1]", b'{"a": "\xff"}', b'{"a": 1', b'{"a": ' + b"[" * 100_000, bytes(1000), good["odom"] + b"!")
    with zenoh.open(session_config((endpoint,), (), sends=False)) as session, Client(endpoint) as client:

        def count_after(send: Callable[[], object], read: Callable[[float], object]) -> None:
            before = client.malformed
            send()
            until(lambda: (read(0.01), client.malformed > before or None)[1])
            assert client.malformed == before + 1

        reads = (client.grid, client.odometry, client.status, client.diagnostics)
        for name, read in zip(good, reads, strict=True):
            publisher = session.declare_publisher(f"echogrid/v1/car/{name}")
            until(lambda read=read: read(0.02), lambda publisher=publisher, name=name: publisher.put(good[name]))
            for payload in noise:
                count_after(lambda publisher=publisher, payload=payload: publisher.put(payload), read)
            count_after(publisher.delete, read)
            publisher.put(good[name])
            assert read(PATIENCE) is not None


FORGETFUL = """
import sys
from echogrid.client import Client
client = Client(sys.argv[1])
grid = client.grid(10)
client.odometry(0)
client.status(0)
print(grid.stamp_ns, grid.occupancy.tolist(), client.alive())
"""


def test_another_process_reads_and_ends_without_closing(endpoint: str) -> None:
    with publish(endpoint) as publisher:
        publisher.grid(42, 0, 0, 0.5, LOG_ODDS)
        command = [sys.executable, "-W", "error", "-c", FORGETFUL, endpoint]
        run = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "42 [[-1, 97, 3], [73, -1, -1]] True\n", "")


SERVICE = """
import sys
import numpy as np
from echogrid.config import Publish
from echogrid.io.publisher import Publisher
publisher = Publisher(Publish(listen=(sys.argv[1],)), "car")
publisher.grid(42, 0, 0, 0.5, np.ones((1024, 1024), dtype=np.float32))
print("up", flush=True)
sys.stdin.read()
"""


def test_a_service_in_another_process_ends_without_closing(endpoint: str) -> None:
    command = [sys.executable, "-W", "error", "-c", SERVICE, endpoint]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as service:
        try:
            assert service.stdout is not None
            assert service.stdin is not None
            assert service.stdout.readline() == "up\n"
            with Client(endpoint) as client:
                grid = client.grid(PATIENCE)
                assert grid is not None
                assert grid.occupancy.shape == (1024, 1024)
                assert (grid.occupancy == 73).all()
                service.stdin.close()
                assert service.wait(PATIENCE) == 0
                until(lambda: None if client.alive() else True)
        finally:
            service.kill()
