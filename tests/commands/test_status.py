"""`echogrid status` as a program, against a publisher."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pytest
import trustme
from tests.support import messages
from tests.support.routers import router
from tests.support.status import status
from tests.support.waiting import PATIENCE, until

from echogrid.client import Client, vehicles
from echogrid.commands.status import only_one
from echogrid.config.tables import Publish, Ros, Tls
from echogrid.zenoh import namesakes
from echogrid.zenoh.publisher import Publisher

COMMAND = [sys.executable, "-W", "error", "-m", "echogrid", "status"]


@contextmanager
def published(endpoint: str, *statuses: dict[str, object], vehicle: str = "car", tls: Tls | None = None) -> Iterator[None]:
    """The statuses in turn, again and again."""
    with Publisher(Publish(listen=(endpoint,), tls=tls), vehicle, Ros()) as publisher, sending(publisher, *statuses):
        yield


@contextmanager
def sending(publisher: Publisher, *statuses: dict[str, object]) -> Iterator[None]:
    """The statuses in turn, again and again."""
    done = threading.Event()

    def send() -> None:
        n = 0
        while not done.wait(0.05):
            publisher.put(messages.status(statuses[n % len(statuses)]))
            n += 1

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def look(endpoint: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, "--endpoint", endpoint, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)


def looks(endpoint: str, *commands: tuple[str, ...]) -> list[subprocess.CompletedProcess[str]]:
    """At once: each may wait for seconds."""
    with ThreadPoolExecutor() as pool:
        return list(pool.map(lambda arguments: look(endpoint, *arguments), commands))


def test_a_service_that_is_well(endpoint: str) -> None:
    with published(endpoint, status()):
        done = look(endpoint)
    assert (done.returncode, done.stderr) == (0, "")
    shown = done.stdout.splitlines()
    assert shown[0] == "car is ok"
    assert shown[1:] == [
        "map       19.5 updates/s, epoch 2",
        "traffic   4,120 frames/s",
        "latency   12.5 ms, 99 % within 31.2 ms",
        "memory    144 MiB",
        "store     ok, 12 MiB",
        "recording failed, 44 MiB: No space left on device",
        'model     default.onnx: "float" is\\as fast here',
        "kernels   compiled",
        "pose      silent: none for 1.4 s, odom at 51.25, -52.50 m, 53.75°, 54 taken",
        *(line for line in shown if line.startswith(("radar", "bus", "counters"))),
    ]
    assert [line.split()[:2] for line in shown[10:-1]] == [
        ["radar", "front_left"],
        ["radar", "rear_right"],
        ["bus", "chassis"],
        ["bus", "radars"],
    ]
    assert shown[10].startswith("radar     front_left  100 complete, 101 incomplete, 102 late, ")
    assert shown[12].startswith("bus       chassis  10 frames, ")
    assert shown[13].startswith("bus       radars   down, 20 frames, ")
    assert "7 dropped frames" in shown[-1]


def test_any_other_state_is_exit_code_2_and_its_reasons_are_said(endpoint: str) -> None:
    with published(endpoint, status("degraded", "radar rear_right: silent for 1.2 s", "bus radars: down")):
        done = look(endpoint)
    assert (done.returncode, done.stderr) == (2, "")
    assert done.stdout.splitlines()[:3] == ["car is degraded", "  radar rear_right: silent for 1.2 s", "  bus radars: down"]


def test_json_is_what_was_sent(endpoint: str) -> None:
    sent = status("stale")
    with published(endpoint, sent, vehicle="red-1"):
        done = look(endpoint, "--vehicle", "red-1", "--json")
    assert done.returncode == 2
    assert json.loads(done.stdout) == json.loads(json.dumps(sent))
    assert done.stdout.count("\n") == 1


def test_with_certificates(endpoint: str, tmp_path: Path) -> None:
    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    for name in ("127.0.0.1", "viewer"):
        certificate = authority.issue_cert(name, common_name=name)
        certificate.cert_chain_pems[0].write_to_path(tmp_path / f"{name}.pem")
        certificate.private_key_pem.write_to_path(tmp_path / f"{name}.key")
    ca, *ours = (str(tmp_path / name) for name in ("ca.pem", "127.0.0.1.pem", "127.0.0.1.key"))
    endpoint = endpoint.replace("tcp/", "tls/")
    with published(endpoint, status(), tls=Tls(ca=ca, certificate=ours[0], key=ours[1], viewers=("viewer",))):
        done = look(endpoint, "--tls", ca, str(tmp_path / "viewer.pem"), str(tmp_path / "viewer.key"))
    assert (done.returncode, done.stderr, done.stdout.split("\n")[0]) == (0, "", "car is ok")


def test_nobody_there_is_one_sentence(endpoint: str) -> None:
    done, named = looks(endpoint, (), ("--vehicle", "car"))
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (f"echogrid: {endpoint}: no vehicle within 5 s, expected a service that listens there\n")
    assert (named.returncode, named.stdout) == (1, "")
    assert named.stderr == (
        f"echogrid: vehicle 'car' at {endpoint}: no status within 5 s, expected a service that listens there for this vehicle\n"
    )


def test_the_vehicle_at_an_endpoint_needs_no_name(endpoint: str) -> None:
    with published(endpoint, status(), vehicle="red-1"):
        done, other = looks(endpoint, (), ("--vehicle", "blue"))
    assert (done.returncode, done.stderr, done.stdout.split("\n")[0]) == (0, "", "red-1 is ok")
    assert (other.returncode, other.stdout) == (1, "")
    assert other.stderr.endswith("expected a service that listens there for this vehicle; there are: red-1\n")


def test_several_vehicles_are_named(endpoint: str) -> None:
    """Two services that are connected to one router."""
    to_router = Publish(listen=(), connect=(endpoint,))
    with router(endpoint), Publisher(to_router, "red", Ros()) as red, Publisher(to_router, "blue", Ros()) as blue:
        until(lambda: vehicles(endpoint) == ["blue", "red"])
        done = look(endpoint)
        assert (done.returncode, done.stdout) == (1, "")
        assert done.stderr == f"echogrid: {endpoint}: the vehicles blue, red are there, expected one: say which with --vehicle\n"
        assert red.vehicle != blue.vehicle


def test_two_services_of_one_name_are_told_by_all(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By both, as long as there are two, and by whoever looks."""
    monkeypatch.setattr(namesakes, "PERIOD", 0.05)
    to_router = Publish(listen=(), connect=(endpoint,))
    with router(endpoint), Publisher(to_router, "red", Ros()) as one, Client(endpoint, "red") as client:
        with Publisher(to_router, "red", Ros()) as other, Publisher(to_router, "blue", Ros()) as blue:
            assert until(one.reasons) == until(other.reasons)
            assert "another service publishes as 'red' too" in one.reasons()[0]
            assert not blue.reasons()
            assert until(lambda: len(client.runs()) == 2 and client.runs()) == {one.gid, other.gid}
            with sending(one, status()):
                done = look(endpoint, "--vehicle", "red")
            assert (done.returncode, done.stdout.split("\n")[0]) == (0, "red is ok")
            assert "2 services publish as vehicle 'red'" in done.stderr
        until(lambda: not one.reasons())
        until(lambda: client.runs() == {one.gid})


def test_what_a_tls_endpoint_needs_is_one_sentence() -> None:
    done = look("tls/127.0.0.1:7447")
    assert (done.returncode, done.stdout) == (1, "")
    assert "expected three PEM files" in done.stderr
    assert "--tls CA CERTIFICATE KEY" in done.stderr
    assert "viewers" in done.stderr
    assert done.stderr.count("\n") == 1


def test_watching_follows_until_it_is_interrupted(endpoint: str) -> None:
    statuses = (status("ok"), status("degraded"))
    with (
        published(endpoint, *statuses),
        subprocess.Popen(
            [*COMMAND, "--endpoint", endpoint, "--watch", "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as watcher,
    ):
        assert watcher.stdout is not None
        seen: set[str] = set()
        for line in watcher.stdout:
            seen.add(json.loads(line)["state"])
            if seen == {"ok", "degraded"}:
                break
        watcher.send_signal(signal.SIGINT)
        _, errors = watcher.communicate(timeout=PATIENCE)
    assert (watcher.returncode, errors) == (130, "")


def test_watching_says_that_it_waits_for_a_service(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """Once, and in the log, so that JSON stays JSON."""
    answers: list[list[str]] = [[], [], ["car"]]
    monkeypatch.setattr("echogrid.commands.status.vehicles", lambda *_: answers.pop(0))
    caplog.set_level("INFO", "echogrid")
    assert only_one("tcp/nowhere:1", None, wait=True) == "car"
    assert [record.getMessage() for record in caplog.records] == [
        "tcp/nowhere:1: no vehicle within 5 s; waiting for a service that listens there"
    ]


def test_watching_says_that_a_service_went_silent(endpoint: str) -> None:
    """An old status is not shown as a new one."""
    command = [*COMMAND, "--endpoint", endpoint, "--watch"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as watcher:
        assert watcher.stdout is not None
        try:
            with published(endpoint, status()):
                while watcher.stdout.readline() != "car is ok\n":
                    pass
            while not (line := watcher.stdout.readline()).startswith("car does not answer, for "):
                assert line
        finally:
            watcher.send_signal(signal.SIGINT)


def test_on_a_terminal_it_is_coloured(endpoint: str) -> None:
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "200"}
    with published(endpoint, status("degraded", "radar rear_right: late")):
        done = subprocess.run([*COMMAND, "--endpoint", endpoint], stdout=theirs, env=environment, timeout=PATIENCE, check=False)
    os.close(theirs)
    with open(ours, "rb", closefd=True) as screen:  # noqa: PTH123  # a descriptor has no path
        text = screen.read1(65536).decode()
    assert done.returncode == 2
    assert "\x1b[1mcar\x1b[0m is \x1b[1;33mdegraded\x1b[0m" in text
    assert "\x1b[33m  radar rear_right: late\x1b[0m" in text
