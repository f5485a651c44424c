"""The client and the publisher, over loopback: in this process and in others."""

from __future__ import annotations

import functools
import itertools
import math
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest
import zenoh

from echogrid.client import Client, MapName, Pose, Window
from echogrid.commands.demo import merge
from echogrid.config.tables import Publish, Ros
from echogrid.core.evidence.raster import GridSpec
from echogrid.core.map.occupancy import OccupancyMap
from echogrid.core.motion.odometry import EgoState
from echogrid.core.motion.se2 import SE2
from echogrid.errors import EchogridError
from echogrid.topics.diagnostic_array import DiagnosticArray, encode_diagnostics
from echogrid.topics.diagnostics import diagnostics
from echogrid.topics.grids import Grid, decode_grid, encode_grid
from echogrid.topics.points import Points, encode_points
from echogrid.topics.poses import Odometry, decode_odometry, encode_odometry
from echogrid.topics.topic import DETECTIONS, KEY, META, Message
from echogrid.zenoh.attachment import encode_attachment, encode_version
from echogrid.zenoh.fleet import compress
from echogrid.zenoh.publisher import Publisher, session_config
from tests.support import messages
from tests.support.status import status as a_status
from tests.support.waiting import PATIENCE, until

LOG_ODDS = np.array([[0, 3.5, -3.5], [1, 0, 0]], dtype=np.float32)


def publish(endpoint: str, vehicle: str = "car") -> Publisher:
    return Publisher(Publish(listen=(endpoint,)), vehicle, Ros())


def test_a_late_joiner_gets_the_last_map_at_once(endpoint: str) -> None:
    with publish(endpoint) as publisher:
        publisher.put(messages.grid(1, 0, 0, 0.5, -LOG_ODDS))
        publisher.put(messages.grid(123_456_789_012, -3, 10, 0.5, LOG_ODDS))
        with Client(endpoint) as client:
            grid = client.grid(PATIENCE)
            assert isinstance(grid, Window)
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
        publisher.put(messages.grid(1, row, column, spec.cell, log_odds))
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
        pose = until(lambda: client.odometry(0.02), lambda: publisher.put(messages.odometry(ego)))
        status = until(lambda: client.status(0.02), lambda: publisher.put(messages.status({"cycles": 3, "sensors": {"fl": {"late": 0}}})))
        received = until(lambda: client.diagnostics(0.02), lambda: publisher.put(messages.diagnostics(sent)))
    assert received == sent
    assert isinstance(pose, Pose)
    assert (pose.stamp_ns, pose.x, pose.y, pose.speed, pose.yaw_rate) == (77, 1.25, -2.5, -1.5, 0.25)
    assert abs(pose.yaw) == pytest.approx(math.pi)
    assert status == {"cycles": 3, "sensors": {"fl": {"late": 0}}}


def test_the_latest_wins(endpoint: str) -> None:
    with publish(endpoint) as publisher, Client(endpoint) as client:
        until(lambda: client.odometry(0.02), lambda: publisher.put(messages.odometry(EgoState(1, SE2(0, 0, 0), 0, 0))))
        beside = client._session.declare_subscriber("echogrid/v1/car/odom")

        def last_came() -> bool:
            sample = beside.try_recv()
            return sample is not None and decode_odometry(bytes(sample.payload)).stamp_ns == 199

        for stamp_ns in range(100, 200):
            publisher.put(messages.odometry(EgoState(stamp_ns, SE2(0, 0, 0), 0, 0)))
        for _ in range(2):  # where the second has come, all who listen have the first
            until(last_came, lambda: publisher.put(messages.odometry(EgoState(199, SE2(0, 0, 0), 0, 0))))
        pose = client.odometry(0.0)
    assert pose is not None
    assert pose.stamp_ns == 199


def test_none_when_the_time_is_over(endpoint: str) -> None:
    with publish(endpoint), Client(endpoint) as client:
        for read in (client.grid, client.odometry, client.status, client.diagnostics):
            started = time.monotonic()
            assert read(0.1) is None
            assert time.monotonic() - started >= 0.1


def test_alive_while_the_service_is(endpoint: str) -> None:
    publisher = publish(endpoint)
    try:
        with Client(endpoint) as client:
            until(client.alive)
            publisher.close()
            until(lambda: not client.alive())
    finally:
        publisher.close()


def test_the_client_may_come_first_and_the_service_come_again(endpoint: str) -> None:
    with Client(endpoint) as client:
        assert not client.alive()
        assert client.grid(0.0) is None
        for stamp_ns in (1, 2):
            with publish(endpoint) as publisher:
                publisher.put(messages.grid(stamp_ns, 0, 0, 0.5, LOG_ODDS))
                grid = client.grid(PATIENCE)
                assert grid is not None
                assert grid.stamp_ns == stamp_ns
                until(client.alive)


def test_one_vehicle_does_not_hear_another(endpoint: str) -> None:
    with publish(endpoint, "red-1") as publisher, Client(endpoint, "red-1") as red, Client(endpoint, "blue") as blue:
        publisher.put(messages.grid(1, 0, 0, 0.5, LOG_ODDS))
        assert red.grid(PATIENCE) is not None
        until(red.alive)
        assert blue.grid(0.05) is None
        assert not blue.alive()


@pytest.mark.parametrize("vehicle", ["", "*", "**", "a/b", "a b", "car\n"])
def test_a_vehicle_that_cannot_be(vehicle: str) -> None:
    with pytest.raises(EchogridError, match=r"^vehicle: "):
        Client(vehicle=vehicle)


@pytest.mark.parametrize("address", ["", "127.0.0.1:7447", "carrier_pigeon/127.0.0.1:7447", "tcp/localhost", "ws/host"])
def test_an_endpoint_that_cannot_be(address: str) -> None:
    with pytest.raises(EchogridError, match=rf"^endpoint: Zenoh refuses '{address}' \(.*\), expected an endpoint such as"):
        Client(address)


def test_malformed_payloads_are_counted_and_skipped(endpoint: str) -> None:
    beside = encode_attachment(1, 5, bytes(16)) + encode_version(0, 1)
    grid = encode_grid(Grid(5, "odom", 0.5, (0.0, 0.0), np.zeros((2, 2), dtype=np.int8)))
    good = {
        "grid/fused/full": grid,
        "grid/fused/key": grid,
        "grid/fused/fleet": compress(grid),
        "odom": encode_odometry(Odometry(5, "odom", "base", SE2(0, 0, 0), 0.0, 0.0)),
        "detections": encode_points(Points(5, "base", np.zeros((2, 3), dtype=np.float32))),
        "status": b'{"state": "running"}',
        "meta": b'{"vehicle": "car"}',
        "diagnostics": encode_diagnostics(DiagnosticArray(5, "", ())),
    }
    noise = (b"", b"\0", b"[1]", b'{"a": "\xff"}', b'{"a": 1', b'{"a": ' + b"[" * 100_000, bytes(1000), good["odom"] + b"!")
    with zenoh.open(session_config((endpoint,), (), sends=False)) as session, Client(endpoint) as client:

        def count_after(send: Callable[[], object], read: Callable[[float], object]) -> None:
            before = client.malformed
            send()
            until(lambda: (read(0.01), client.malformed > before)[1])
            assert client.malformed == before + 1

        reads = (
            client.grid,
            client.follow,
            client.fleet,
            client.odometry,
            client.detections,
            client.status,
            client.meta,
            client.diagnostics,
        )
        for name, read in zip(good, reads, strict=True):
            publisher = session.declare_publisher(f"echogrid/v1/car/{name}", congestion_control=zenoh.CongestionControl.BLOCK)
            put = functools.partial(publisher.put, attachment=beside)
            until(lambda read=read: read(0.02), lambda put=put, name=name: put(good[name]))
            while read(0.05) is not None:  # one that is still on its way
                pass
            for payload in noise:
                count_after(lambda put=put, payload=payload: put(payload), read)
            count_after(publisher.delete, read)
            if name.startswith("grid/"):
                count_after(lambda publisher=publisher, name=name: publisher.put(good[name]), read)  # of no known map
                beside_next = encode_attachment(2, 5, bytes(16)) + encode_version(0, 2)
                put = functools.partial(publisher.put, attachment=beside_next)
            put(good[name])
            assert read(PATIENCE) is not None


FORGETFUL = """
import sys
from echogrid.client import Client
client = Client(sys.argv[1])
grid = client.grid(float(sys.argv[2]))
client.odometry(0)
client.status(0)
while not client.alive():
    pass
print(grid.stamp_ns, grid.occupancy.tolist())
"""


def test_another_process_reads_and_ends_without_closing(endpoint: str) -> None:
    with publish(endpoint) as publisher:
        publisher.put(messages.grid(42, 0, 0, 0.5, LOG_ODDS))
        command = [sys.executable, "-W", "error", "-c", FORGETFUL, endpoint, str(PATIENCE)]
        run = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "42 [[-1, 97, 3], [73, -1, -1]]\n", "")


SERVICE = """
import sys
import numpy as np
from echogrid.config.tables import Publish, Ros
from echogrid.zenoh.publisher import Publisher
from tests.support import messages
publisher = Publisher(Publish(listen=(sys.argv[1],)), "car", Ros())
publisher.put(messages.grid(42, 0, 0, 0.5, np.ones((1024, 1024), dtype=np.float32)))
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
                until(lambda: not client.alive())
        finally:
            service.kill()


def test_follow_lays_updates_over_the_key_frame_that_they_name(endpoint: str) -> None:
    whole = messages.grid(100, -3, 10, 0.5, LOG_ODDS, topic=KEY, epoch=2, keyframe=4)
    cells = np.array([[7, 8]], dtype=np.int8)
    with publish(endpoint) as publisher, Client(endpoint) as client:
        publisher.put(whole)
        first = client.follow(PATIENCE)
        assert first is not None
        assert client.follow(0.0) is None
        send = functools.partial(publisher.put, messages.update(4, 200, cells, x=1, y=0, epoch=2))
        second = until(lambda: client.follow(0.02), send)
        for other in (messages.update(5, 300, cells, epoch=2), messages.update(4, 300, np.zeros((3, 1), np.int8), epoch=2)):
            publisher.put(other)  # of a key frame that did not come, and beyond the one that did
            assert client.follow(0.2) is None
        until(lambda: client.follow(0.0) is None and client.malformed == 1)  # for the second has come
        publisher.put(messages.grid(400, 0, 0, 0.5, -LOG_ODDS, topic=KEY, epoch=3, keyframe=5))
        third = client.follow(PATIENCE)
    assert (first.stamp_ns, first.origin, first.map.epoch) == (100, (5.0, -1.5), 2)
    np.testing.assert_array_equal(first.occupancy, [[-1, 97, 3], [73, -1, -1]])
    assert (second.stamp_ns, second.origin, second.map) == (200, (5.0, -1.5), first.map)
    np.testing.assert_array_equal(second.occupancy, [[-1, 7, 8], [73, -1, -1]])
    assert third is not None
    assert (third.stamp_ns, third.map) == (400, (first.map.source, 3))
    np.testing.assert_array_equal(third.occupancy, [[-1, 3, 97], [27, -1, -1]])
    assert client.malformed == 1


def test_the_stream_for_slow_links_is_made_only_for_those_who_listen(endpoint: str) -> None:
    random = np.random.default_rng(2)
    log_odds = random.uniform(-4, 4, (40, 50)).astype(np.float32) * (random.random((40, 50)) < 0.7)
    sent = decode_grid(messages.grid(0, 0, 0, 0.5, log_odds).payload).occupancy
    second = 10**9
    with publish(endpoint) as publisher, Client(endpoint) as client:
        publisher.put(messages.grid(second, 0, 0, 0.5, log_odds))
        assert publisher._fleet.made_ns is None
        stamps = iter(range(2 * second, 10**18, second // 4))
        window = until(lambda: client.fleet(0.02), lambda: publisher.put(messages.grid(next(stamps), 0, 0, 0.5, log_odds, epoch=3)))
        made = {window.stamp_ns}

        def came(stamp_ns: int) -> bool:
            more = client.fleet(0.02)
            made.update(() if more is None else (more.stamp_ns,))
            return stamp_ns in made

        for stamp_ns in itertools.islice(stamps, 16):  # four seconds
            publisher.put(messages.grid(stamp_ns, 0, 0, 0.5, log_odds, epoch=3))
            if publisher._fleet.made_ns == stamp_ns:
                until(functools.partial(came, stamp_ns))
    assert all(later - earlier >= second for earlier, later in itertools.pairwise(sorted(made)))
    assert 4 <= len(made) <= 5
    assert window.map.epoch == 3
    np.testing.assert_array_equal(window.occupancy < 0, sent < 0)
    assert set(np.unique(window.occupancy[sent >= 0]).tolist()) == {0, 25, 50, 75, 100}
    assert np.abs(window.occupancy[sent >= 0] - sent[sent >= 0]).max() <= 12


def test_the_stream_for_slow_links_can_be_turned_off(endpoint: str) -> None:
    with Publisher(Publish(listen=(endpoint,), fleet_hz=0.0), "car", Ros()) as publisher, Client(endpoint) as client:
        until(
            lambda: client.grid(0.02) is not None and client.fleet(0.02) is None,
            lambda: publisher.put(messages.grid(1, 0, 0, 0.5, LOG_ODDS)),
        )
        publisher.put(messages.grid(2, 0, 0, 0.5, LOG_ODDS))
        assert client.fleet(0.2) is None


def test_meta_comes_at_once_and_detections_as_they_are(endpoint: str) -> None:
    points = Points(5, "base", np.array([[1.5, -2.0, 0.0]], np.float32))
    with publish(endpoint) as publisher, Client(endpoint) as client:
        publisher.put(Message(META, b'{"vehicle": "car"}', 1, 0, 0))
        assert client.meta(PATIENCE) == {"vehicle": "car"}
        received = until(lambda: client.detections(0.02), lambda: publisher.put(Message(DETECTIONS, encode_points(points), 5, 0, 0)))
    assert (received.stamp_ns, received.frame) == (5, "base")
    np.testing.assert_array_equal(received.points, points.points)


def test_windows_of_older_maps_are_left_out_where_windows_are_put_together() -> None:
    def window(stamp_ns: int, column: int, value: int, source: bytes, epoch: int) -> Window:
        return Window(stamp_ns, "odom", 0.5, (column * 0.5, 0.0), np.full((2, 2), value, np.int8), MapName(source, epoch))

    windows = [window(1, 0, 90, b"one", 0), window(2, 1, 80, b"two", 0), window(3, 5, 70, b"two", 1), window(4, 6, 60, b"two", 1)]
    origin, log_odds = merge(windows)
    assert origin == (2.5, 0.0)
    np.testing.assert_allclose(100 / (1 + np.exp(-log_odds)), [[70, 60, 60], [70, 60, 60]], rtol=1e-6)
