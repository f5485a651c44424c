"""Vehicles and clients that meet at a Zenoh router, which may go away and come back."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import zenoh
from tests.support import messages
from tests.support.messages import update
from tests.support.ports import free_port
from tests.support.routers import router
from tests.support.waiting import until

from echogrid.client import Client, MapName, Window
from echogrid.config.tables import Publish, Ros
from echogrid.topics.topic import KEY, Message
from echogrid.zenoh.publisher import Publisher, session_config
from echogrid.zenoh.routers import linked_of


def connected(endpoint: str, vehicle: str, namespace: str = "/echogrid") -> Publisher:
    return Publisher(Publish(listen=(), connect=(endpoint,)), vehicle, Ros(namespace=namespace))


def key_frame(number: int, value: float, epoch: int = 0) -> Message:
    return messages.grid(100 * number, 0, 0, 0.5, np.full((4, 6), value, np.float32), topic=KEY, epoch=epoch, keyframe=number)


def test_zenoh_knows_each_key_of_the_retries() -> None:
    """It drops one that it does not know, where it refuses one elsewhere (findings/zenoh_config_misspelt.sh)."""
    retry = json.loads(session_config((), ("tcp/127.0.0.1:7447",), sends=True).get_json("connect/retry"))
    assert retry
    assert None not in retry.values()


def test_after_the_router_comes_back_all_goes_on(endpoint: str) -> None:
    """What was sent meanwhile is lost; the key frame of then comes, and updates for it."""
    with connected(endpoint, "car") as publisher, Client(endpoint) as client:
        latest: list[tuple[int, int]] = []  # stamps, and what the first cell holds

        def seen(stamp_ns: int, percent: int) -> Callable[[], bool]:
            def looked() -> bool:
                window = client.follow(0.05)
                latest.extend([] if window is None else [(window.stamp_ns, int(window.occupancy[0, 0]))])
                return (stamp_ns, percent) in latest

            return looked

        # Again and again, as a service does: where both connect at the same time, Zenoh may ask for the last one before it can be had.
        with router(endpoint):
            until(seen(100, 73), lambda: publisher.put(key_frame(1, 1.0)))
            until(client.alive)
        until(lambda: not client.alive())
        publisher.put(update(1, 150, np.full((1, 1), 50, np.int8)))
        with router(endpoint):
            until(seen(200, 27), lambda: publisher.put(key_frame(2, -1.0)))
            until(client.alive)
            until(seen(275, 60), lambda: publisher.put(update(2, 275, np.full((1, 1), 60, np.int8))))
        assert 150 not in dict(latest)


def test_a_router_that_is_not_there_is_told_once_and_so_is_its_coming(endpoint: str, caplog: pytest.LogCaptureFixture) -> None:
    """Each time that it goes or comes."""
    caplog.set_level("INFO", "echogrid")
    away, there = f"publish.connect: '{endpoint}' is not connected", f"publish.connect: '{endpoint}' is connected"
    with connected(endpoint, "car") as publisher:
        for _ in range(3):
            assert [reason.partition(":")[0] for reason in publisher.reasons()] == ["publish.connect"]
        for _ in range(2):
            with router(endpoint):
                until(lambda: not publisher.reasons())
                assert not publisher.reasons()
            until(publisher.reasons)
    assert [message.partition(": the service")[0] for message in caplog.messages] == [away, there, away, there, away]


def test_a_subscriber_that_connects_is_no_router(endpoint: str) -> None:
    own = f"tcp/127.0.0.1:{free_port()}"
    with Publisher(Publish(listen=(own,), connect=(endpoint,)), "car", Ros()) as publisher, Client(own) as client:
        until(client.alive)
        assert publisher.reasons()
        with router(endpoint):
            until(lambda: not publisher.reasons())
    with Publisher(Publish(listen=(endpoint,)), "car", Ros()) as publisher:
        assert not publisher.reasons()


@pytest.mark.parametrize(
    ("endpoints", "links", "missing"),
    [
        (["tcp/10.0.0.9:7447"], ["tcp/10.0.0.9:7447"], []),
        (["tcp/10.0.0.9:7447"], ["tcp/10.0.0.9:7448", "tcp/10.0.0.8:7447", "udp/10.0.0.9:7447"], ["'tcp/10.0.0.9:7447'"]),
        (["tls/router.local:7447"], ["tls/10.0.0.9:7447"], []),
        (["tls/router.local:7447"], ["tls/10.0.0.9:40001"], ["'tls/router.local:7447'"]),
        (["tcp/10.0.0.9:7447?prio=1-7;rel=1#so_sndbuf=65000"], ["tcp/10.0.0.9:7447?prio=1-7;rel=1"], []),
        (["tcp/[::1]:7447"], ["tcp/[0:0:0:0:0:0:0:1]:7447"], []),
        (["tcp/[fe80::1%eth0]:7447"], ["tcp/[fe80::1%2]:7447"], []),
        (["unixsock-stream//run/zenoh"], ["unixsock-stream//run/zenoh"], []),
        (["unixsock-stream//run/zenoh"], ["unixsock-stream/a0d6185d-d3dc-4c30-97e0-a9967cf1d2de"], ["'unixsock-stream//run/zenoh'"]),
        (["tcp/a:7447", "tcp/b:7447"], ["tcp/10.0.0.9:7447"], ["'tcp/a:7447' or 'tcp/b:7447'"]),
        (["tcp/a:7447", "tcp/b:7447"], ["tcp/10.0.0.9:7447", "tcp/10.0.0.8:7447"], []),
        (["tcp/a:7447", "tcp/10.0.0.9:7447"], ["tcp/10.0.0.9:7447"], ["'tcp/a:7447'"]),
        (["tcp/10.0.0.9:7447", "tcp/10.0.0.9:7447"], ["tcp/10.0.0.9:7447"], []),
    ],
)
def test_a_link_is_that_of_the_endpoint_where_it_leads(endpoints: list[str], links: list[str], missing: list[str]) -> None:
    assert [name for name, up in linked_of(endpoints, links).items() if not up] == missing


SERVICE = """
import sys
from tests.zenoh.test_router import connected, key_frame
with connected(sys.argv[1], "car") as publisher:
    for line in sys.stdin:
        number, value, epoch = line.split()
        publisher.put(key_frame(int(number), float(value), int(epoch)))
"""


@contextmanager
def service(endpoint: str) -> Iterator[Callable[[int, float, int], None]]:
    """A process that publishes a key frame at each call; killed at the end."""
    command = [sys.executable, "-c", SERVICE, endpoint]
    with subprocess.Popen(command, stdin=subprocess.PIPE, text=True) as process:

        def publish(number: int, value: float, epoch: int) -> None:
            assert process.stdin is not None
            process.stdin.write(f"{number} {value} {epoch}\n")
            process.stdin.flush()

        try:
            yield publish
        finally:
            process.kill()


def test_a_service_that_comes_back_brings_another_map(endpoint: str) -> None:
    with router(endpoint), Client(endpoint) as client:
        maps: dict[MapName, Window] = {}

        def seen(count: int) -> bool:
            window = client.follow(0.02)
            maps.update({} if window is None else {window.map: window})
            return len(maps) == count

        with service(endpoint) as publish:
            until(lambda: seen(1), lambda: publish(7, 1.0, 0))
        with service(endpoint) as publish:
            until(lambda: seen(2), lambda: publish(1, -1.0, 0))
            until(lambda: seen(3), lambda: publish(2, 1.0, 1))
    (first, _), (second, window), (third, _) = maps.items()
    assert first.epoch == second.epoch == 0
    assert (window.occupancy == 27).all()
    assert (third.source, third.epoch) == (second.source, 1)


def test_two_vehicles_are_kept_apart_and_one_subscriber_sees_both(endpoint: str) -> None:
    with (
        router(endpoint),
        connected(endpoint, "red", "/red") as red,
        connected(endpoint, "blue", "/blue") as blue,
        Client(endpoint, "red") as red_client,
        Client(endpoint, "blue") as blue_client,
        zenoh.open(session_config((), (endpoint,), sends=False)) as session,
    ):
        everything = session.declare_subscriber("echogrid/v1/*/grid/fused/key")
        to_ros = session.declare_subscriber("0/*/map/**")

        def send() -> None:
            red.put(key_frame(1, 1.0))
            blue.put(key_frame(1, -1.0))

        for client, value in ((red_client, 73), (blue_client, 27)):
            window: Window | None = until(lambda client=client: client.follow(0.02), send)
            while window is not None:
                assert (window.occupancy == value).all()
                window = client.follow(0.05)
        seen: dict[str, set[bytes]] = {}

        def collect() -> bool:
            for subscriber in (everything, to_ros):
                while (sample := subscriber.try_recv()) is not None:
                    seen.setdefault(str(sample.key_expr).split("/OccupancyGrid")[0], set()).add(bytes(sample.payload)[-24:])
            return len(seen) == 4

        until(collect, send)
    values = {key.split("/nav_msgs")[0]: {payload[0] for payload in payloads} for key, payloads in seen.items()}
    ours = {f"echogrid/v1/{vehicle}/grid/fused/key": {value} for vehicle, value in (("red", 73), ("blue", 27))}
    assert values == ours | {"0/red/map": {73}, "0/blue/map": {27}}
