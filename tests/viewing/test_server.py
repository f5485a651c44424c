"""Traffic that no page of ours sends: each is refused in one sentence, and those who watch lose nothing."""

from __future__ import annotations

import http.client
import json
import re
import socket
import ssl
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trustme
from tests.support.pages import Seen, served, watch
from tests.support.program import echogrid
from tests.support.waiting import until
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from echogrid.commands.showing.view import Wanted, show_of
from echogrid.errors import EchogridError
from echogrid.viewing import viewer as viewing
from echogrid.viewing.doors import Door, door
from echogrid.viewing.scene import Scene
from echogrid.viewing.server import LONGEST, MOST_BYTES, NO_TOKEN, page_files
from echogrid.viewing.shows import LiveShow, MapShow
from echogrid.viewing.wire import Kind, Plane

TOKEN = "correct-horse-battery"


def some_map() -> MapShow:
    scene = Scene({"shown": "map", "name": "some.npz", "planes": ["OCCUPANCY"], "timeline": False})
    scene.cell = 0.25
    scene.cells(Plane.OCCUPANCY, 0, 0, np.arange(32 * 64).reshape(32, 64) % 100)
    return MapShow(scene)


def get(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    result = answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    connection.close()
    return result


def ending(connection: ClientConnection) -> tuple[int, str]:
    """Code and reason with which the server closes."""
    while True:
        try:
            connection.recv(timeout=60)
        except ConnectionClosed as closed:
            return (closed.rcvd.code, closed.rcvd.reason) if closed.rcvd else (0, "the connection was cut")


def test_the_page_comes_whole_and_may_load_nothing_from_elsewhere() -> None:
    with served(some_map()) as (_, port):
        for path, body in page_files().items():
            status, headers, received = get(port, path)
            assert (status, received) == (200, body)
            assert headers["content-security-policy"].startswith("default-src 'none'; script-src 'self';")
            assert headers["x-content-type-options"] == "nosniff"
        with watch(port) as viewer:
            seen = Seen()
            while Kind.TRAIL not in seen.kinds:
                seen.take(viewer.recv(timeout=60))
        assert seen.documents[Kind.HELLO]["name"] == "some.npz"
        np.testing.assert_array_equal(seen.cells(Plane.OCCUPANCY, 0, 0, 32, 64, -1), np.arange(32 * 64).reshape(32, 64) % 100)


@pytest.mark.parametrize(
    "path",
    [
        "/../server.py",
        "/..%2fserver.py",
        "/%2e%2e/server.py",
        "/page/index.html",
        "//index.html",
        "/index.html%00",
        "/index.html/",
        "/.",
        "/main.js/..",
        "/wire.py",
    ],
)
def test_no_path_leads_out_of_the_page(path: str) -> None:
    with served(some_map()) as (_, port):
        status, _, body = get(port, path)
        assert (status, body) == (404, b"there is no such page here, expected /\n")


@pytest.mark.parametrize(
    ("headers", "sentence"),
    [
        ({"Origin": "https://evil.example"}, "the request comes from a page of 'https://evil.example', expected one from here"),
        ({"Origin": "null"}, "the request comes from a page of 'null', expected one from here"),
        ({"Host": "evil.example"}, "this page is for this machine alone, and the request is for the host 'evil.example'"),
        ({"Host": "[::1"}, "the request names no host"),
    ],
)
def test_pages_from_elsewhere_and_names_that_were_turned_to_us_are_refused(headers: dict[str, str], sentence: str) -> None:
    with served(some_map()) as (_, port):
        for path in ("/", "/socket"):
            status, _, body = get(port, path, **headers)
            assert (status, body.decode()) == (403, f"{sentence}\n")
        if "Origin" in headers:
            with pytest.raises(InvalidStatus, match="403"), connect(f"ws://127.0.0.1:{port}/socket", origin=headers["Origin"]):
                pass
        with watch(port, origin=f"http://127.0.0.1:{port}") as viewer:  # our own
            assert viewer.recv(timeout=60)[0] == Kind.HELLO


@pytest.mark.parametrize(
    ("word", "code", "reason"),
    [
        ("x" * (LONGEST + 1), 1008, "not a word of this page: 1025 characters, expected at most 1024"),
        ("x" * (MOST_BYTES + 1), 1009, ""),
        ("{" * 900, 1008, "not a word of this page: "),
        ("[1, 2]", 1008, "not a word of this page: Expected `object`, got `array`"),
        ('{"steer": 1}', 1008, "not a word of this page: Object contains unknown field `steer`"),
        ('{"seek": "1"}', 1008, "not a word of this page: Expected `float | null`, got `str` - at `$.seek`"),
        (b"\x00\x01", 1008, "not a word of this page: binary"),
    ],
    ids=["long", "oversized", "garbage", "an array", "an unknown word", "another type", "binary"],
)
@pytest.mark.parametrize("when", ["first", "later"])
def test_what_no_page_of_ours_says_ends_in_one_sentence(word: str | bytes, code: int, reason: str, when: str) -> None:
    with served(some_map()) as (server, port), watch(port) as quiet:
        seen = Seen()
        seen.take(quiet.recv(timeout=60))
        with connect(f"ws://127.0.0.1:{port}/socket", compression=None, max_size=None) as hostile:
            if when == "later":
                hostile.send("{}")
                hostile.recv(timeout=60)
            hostile.send(word)
            ended, said = ending(hostile)
        assert ended == code
        assert said.startswith(reason)
        while Kind.TRAIL not in seen.kinds:  # the other one loses nothing
            seen.take(quiet.recv(timeout=60))
        until(lambda: len(server.viewers) == 1)


def test_without_the_token_nothing_is_told() -> None:
    guarded = Door("127.0.0.1", 0, TOKEN, None)
    with served(some_map(), guarded) as (_, port):
        for word in ({}, {"token": "wrong-horse-battery"}, {"token": ""}):
            with watch(port, word) as viewer:
                assert ending(viewer) == (NO_TOKEN, "the token is missing or wrong: open the address that `echogrid view` printed")
        with watch(port, {"token": TOKEN}) as viewer:
            assert viewer.recv(timeout=60)[0] == Kind.HELLO


def test_what_is_no_http_costs_nobody_anything(capfd: pytest.CaptureFixture[str]) -> None:
    with served(some_map()) as (_, port):
        for data in (
            b"\x16\x03\x01" * 100,
            b"GET " + b"/a" * 20000 + b" HTTP/1.1\r\n\r\n",
            b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999\r\n\r\n",
        ):
            with socket.create_connection(("127.0.0.1", port), timeout=60) as hostile:
                hostile.sendall(data)
                answer = hostile.recv(4096)
            assert answer[:12] in (b"HTTP/1.0 400", b"HTTP/1.1 400", b"HTTP/1.1 405", b"HTTP/1.1 403")
        assert get(port, "/")[0] == 200
    assert "Traceback" not in capfd.readouterr().err


class Feed:
    """Of a LiveShow: frames that a test sends."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.scene = Scene({"shown": "live", "name": "", "planes": [], "timeline": False})
        self.send = lambda frames: None

    def run(self, stop, send) -> None:
        self.send = send
        stop.wait()


def test_who_does_not_read_is_dropped_and_told_and_delays_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames of a MiB each, for one who reads and one who does not: the one gets all of them, in order, the other its reason."""
    monkeypatch.setattr(viewing, "PATIENCE", 2.0)
    feed, count = Feed(), 60
    show = LiveShow(feed)
    with served(show) as (_, port), watch(port) as reader, watch(port, max_queue=1):
        until(lambda: len(show.viewers) == 2)
        numbers, behind = [], 0.0
        for number in range(count):
            began = time.monotonic()
            feed.send([bytes((Kind.BLOCKS, 0)) + number.to_bytes(2, "little") + bytes(1 << 20)])
            while True:
                frame = reader.recv(timeout=60)
                if frame[0] == Kind.BLOCKS:
                    numbers.append(int.from_bytes(frame[2:4], "little"))
                    break
            behind = max(behind, time.monotonic() - began)
        assert numbers == list(range(count))
        until(lambda: len(show.viewers) == 1)  # the sleeper is gone
        assert behind < viewing.PATIENCE  # nobody waited until it was


def test_the_reason_of_a_slow_viewer_reaches_it_when_it_reads_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewing, "MOST_WAITING", 1 << 16)
    feed = Feed()
    show = LiveShow(feed)
    with served(show) as (_, port), watch(port) as viewer:
        until(lambda: len(show.viewers) == 1)
        feed.send([bytes((Kind.BLOCKS, 0, 0, 0)) + bytes(1 << 15)] * 4)
        code, reason = ending(viewer)
        assert (code, reason) == (1013, viewing.TOO_SLOW)


def test_there_is_room_for_so_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("echogrid.viewing.server.MOST_VIEWERS", 1)
    with served(some_map()) as (_, port), watch(port) as first:
        first.recv(timeout=60)
        with connect(f"ws://127.0.0.1:{port}/socket") as second:
            assert ending(second) == (1013, "1 viewers are here already, try again later")


# ---- who may open it wider ----


def test_a_page_that_others_can_reach_needs_a_token_and_tls(tmp_path: Path) -> None:
    token, authority = tmp_path / "token", trustme.CA()
    token.write_text(f"{TOKEN}\n")
    issued = authority.issue_cert("127.0.0.1")
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    issued.cert_chain_pems[0].write_to_path(certificate)
    issued.private_key_pem.write_to_path(key)
    wide = ("0.0.0.0", 0)
    for given, missing in (
        ({"token": None, "certificate": None}, "--token FILE and --certificate CERT KEY with it, or --plaintext"),
        ({"token": token, "certificate": None}, "expected --certificate CERT KEY with it"),
        ({"token": None, "certificate": (certificate, key)}, "expected --token FILE with it"),
    ):
        with pytest.raises(EchogridError, match=f"--listen: 0.0.0.0 can be reached from other machines, .*{missing}"):
            door(wide, **given, plaintext=False)
    assert door(wide, token, None, plaintext=True).token == TOKEN
    guarded = door(wide, token, (certificate, key), plaintext=False)
    context = ssl.create_default_context()
    authority.configure_trust(context)
    with served(some_map(), guarded) as (_, port):
        address = f"wss://127.0.0.1:{port}/socket"
        with connect(address, ssl=context, compression=None, origin=f"https://127.0.0.1:{port}") as viewer:
            viewer.send(json.dumps({"token": TOKEN}))
            assert viewer.recv(timeout=60)[0] == Kind.HELLO
        with connect(address, ssl=context) as viewer:
            viewer.send("{}")
            assert ending(viewer)[0] == NO_TOKEN


@pytest.mark.parametrize(
    ("content", "sentence"),
    [(b"short", "expected at least 16 printable ASCII"), (b"\xff" * 20, "cannot be read"), (b"two words of a sentence", "without spaces")],
)
def test_a_token_that_is_none_is_refused(tmp_path: Path, content: bytes, sentence: str) -> None:
    (tmp_path / "token").write_bytes(content)
    with pytest.raises(EchogridError, match=f"--token: .*token: .*{sentence}"):
        door(("127.0.0.1", 0), tmp_path / "token", None, plaintext=False)


def test_the_command_refuses_in_one_sentence(tmp_path: Path) -> None:
    for arguments, sentence in (
        (
            ("--listen", "0.0.0.0:0"),
            "--listen: 0.0.0.0 can be reached from other machines, expected --token FILE and --certificate CERT KEY",
        ),
        ((tmp_path / "nothing",), f"{tmp_path / 'nothing'}: there is no such file or folder"),
        ((tmp_path / "map.egmap",), f"{tmp_path / 'map.egmap'}: there is no such file"),
        ((tmp_path / "drive.mcap",), f"{tmp_path / 'drive.mcap'}: cannot be read"),
        (("--demo", tmp_path), "--demo: found with"),
        (("--certificate", tmp_path / "a", tmp_path / "b", "--demo"), f"--certificate: {tmp_path / 'a'}: cannot be read: No such file"),
    ):
        done = echogrid("view", *arguments)
        assert done.returncode == 1
        assert done.stderr.startswith(f"echogrid: {sentence}")
        assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("what", "option", "value", "sentence"),
    [
        (None, "epoch", 3, "--epoch: is not for a running service"),
        ("map.npz", "model", "paper", "--model: is not for a stored map"),
        ("drive.mcap", "model", "paper", "--model: is not for a recording as it was published"),
        ("drive", "epoch", 3, "--epoch: is not for a drive"),
        ("drive", "vehicle", "car", "--vehicle: is not for a drive"),
    ],
)
def test_an_option_that_would_change_nothing_is_refused(what: str | None, option: str, value: object, sentence: str) -> None:
    plain = Wanted(None if what is None else Path(what), None, None, None, "tcp/127.0.0.1:1", None, None)
    with pytest.raises(EchogridError, match=re.escape(sentence)):
        show_of(replace(plain, **{option: value}))
