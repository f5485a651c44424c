"""Bytes that no browser sends: whoever sends them is cut off, the others lose nothing, and the log stays free of tracebacks."""

from __future__ import annotations

import base64
import os
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest
from tests.support.pages import Seen, served, watch
from tests.support.waiting import until
from tests.viewing.test_server import TOKEN, ending, get, some_map

from echogrid.viewing.doors import Door
from echogrid.viewing.server import MOST_BYTES
from echogrid.viewing.wire import Kind

TEXT, CONTINUED, BINARY, CLOSE, PING = 1, 0, 2, 8, 9


def frame(kind: int, data: bytes, *, last: bool = True, reserved: int = 0) -> bytes:
    """As RFC 6455 writes it."""
    first = (0x80 if last else 0) | reserved << 4 | kind
    size, mask = len(data), 0x80  # masked
    if size < 126:
        head = struct.pack(">BB", first, mask | size)
    elif size < 1 << 16:
        head = struct.pack(">BBH", first, mask | 126, size)
    else:
        head = struct.pack(">BBQ", first, mask | 127, size)
    return head + bytes(4) + data  # masked with zeros, which changes nothing


@contextmanager
def shaken(port: int, extensions: str = "") -> Iterator[tuple[socket.socket, str]]:
    """A bare connection that has become a WebSocket, and the head of the answer."""
    with socket.create_connection(("127.0.0.1", port), timeout=60) as raw:
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [
            "GET /socket HTTP/1.1",
            f"Host: 127.0.0.1:{port}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
        ]
        lines += [f"Sec-WebSocket-Key: {key}"] + ([f"Sec-WebSocket-Extensions: {extensions}"] if extensions else [])
        raw.sendall("\r\n".join([*lines, "", ""]).encode())
        head = b""
        while b"\r\n\r\n" not in head:
            head += raw.recv(1)
        assert head.startswith(b"HTTP/1.1 101")
        yield raw, head.decode()


def closed(raw: socket.socket) -> int:
    """The code with which the server ends it; 0 where it just cuts."""
    data = b""
    while True:
        try:
            part = raw.recv(1 << 16)
        except ConnectionError:
            part = b""
        if not part:
            break
        data += part
    end = data.rfind(bytes([0x80 | CLOSE]))
    return 0 if end < 0 or len(data) < end + 4 else struct.unpack_from(">H", data, end + 2)[0]


@pytest.mark.parametrize(
    ("sent", "codes"),
    [
        ([frame(TEXT, b"{}", reserved=4)], {1002}),
        ([frame(TEXT, b"{}", reserved=2)], {1002}),
        ([frame(3, b"{}")], {1002}),
        ([frame(PING, bytes(126))], {1002}),
        ([frame(PING, b"x", last=False)], {1002}),
        ([frame(CONTINUED, b"{}")], {1002}),
        ([frame(TEXT, b"{", last=False), frame(TEXT, b"}")], {1002}),
        ([frame(TEXT, b"\xff\xfe")], {1007}),
        ([frame(CLOSE, b"\x00")], {1002}),
        ([frame(CLOSE, struct.pack(">H", 999))], {1002}),
        ([frame(TEXT, b"x" * 4096, last=False), *[frame(CONTINUED, b"x" * 4096, last=False)] * (MOST_BYTES // 4096)], {1009}),
        ([struct.pack(">BBQ", 0x81, 0xFF, (1 << 63) - 1) + bytes(4) + b"x" * 1000], {1009}),
        ([frame(TEXT, b'{"token": "\\ud800"}')], {1008}),
        ([b"\x00" * 100_000], {1002, 0}),
    ],
    ids=[
        *("reserved bit, compressed", "reserved bit", "unknown kind", "long ping", "ping in parts", "continues nothing"),
        *("another begins", "no text", "torn close", "unknown close", "oversized in parts", "far too long", "half a character", "zeros"),
    ],
)
def test_frames_that_break_the_protocol_end_their_connection(sent: list[bytes], codes: set[int], capfd: pytest.CaptureFixture[str]) -> None:
    with served(some_map(), Door("127.0.0.1", 0, TOKEN, None)) as (server, port), watch(port, {"token": TOKEN}) as quiet:
        seen = Seen()
        seen.take(quiet.recv(timeout=60))
        with shaken(port) as (raw, _):
            for part in sent:
                try:
                    raw.sendall(part)
                except ConnectionError:
                    break
            assert closed(raw) in codes
        while Kind.TRAIL not in seen.kinds:
            seen.take(quiet.recv(timeout=60))
        until(lambda: len(server.viewers) == 1)
    assert "Traceback" not in capfd.readouterr().err


def test_nobody_packs_a_bomb() -> None:
    """Compression is offered and not taken."""
    with served(some_map()) as (_, port), shaken(port, "permessage-deflate; client_max_window_bits") as (_, head):
        assert "extensions" not in head.lower()


@pytest.mark.parametrize("origin", ["http://[", "http://[::1", "//", "http://a b", "http://" + "a" * 4000])
def test_an_origin_that_is_none_is_refused(origin: str) -> None:
    with served(some_map()) as (_, port):
        status, _, body = get(port, "/", Origin=origin)
        assert (status, body.decode().count("\n")) == (403, 1)
        assert body.startswith(b"the request comes from a page of '")


def test_who_says_nothing_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("echogrid.viewing.server.FIRST_WORD", 0.3)
    with served(some_map()) as (server, port), watch(port, {}) as quiet:
        assert quiet.recv(timeout=60)[0] == Kind.HELLO
        with shaken(port) as (raw, _):
            assert closed(raw) == 1008
        until(lambda: len(server.viewers) == 1)


def test_a_flood_of_words_delays_nobody() -> None:
    """10,000 words that the page could say, and pings, from one who does not read; another is told all the while."""
    with served(some_map()) as (_, port), shaken(port) as (raw, _):
        flood = frame(TEXT, b'{"seek": 1}') * 10_000 + frame(PING, b"x") * 10_000
        raw.settimeout(0.05)
        began, sent = time.monotonic(), 0
        for _ in range(5):
            with suppress(TimeoutError):
                sent += raw.send(flood[sent : sent + (1 << 16)])
            with watch(port) as other:
                seen = Seen()
                while Kind.TRAIL not in seen.kinds:
                    seen.take(other.recv(timeout=60))
        assert sent > 0
        assert time.monotonic() - began < 60


def test_connections_that_ask_for_nothing_leave_room(capfd: pytest.CaptureFixture[str]) -> None:
    """Bare ones, and heads that come a byte at a time."""
    with served(some_map()) as (_, port):
        idle = [socket.create_connection(("127.0.0.1", port), timeout=60) for _ in range(200)]
        for raw in idle[:100]:
            raw.sendall(b"GET / HT")
        assert get(port, "/")[0] == 200
        with watch(port) as viewer:
            assert viewer.recv(timeout=60)[0] == Kind.HELLO
        for raw in idle:
            raw.close()
        assert get(port, "/")[0] == 200
    assert "Traceback" not in capfd.readouterr().err


def test_a_token_with_half_a_character_is_a_wrong_one() -> None:
    with served(some_map(), Door("127.0.0.1", 0, TOKEN, None)) as (_, port), watch(port, {"token": "é" * 20}) as viewer:
        assert ending(viewer)[1].startswith("the token is missing or wrong")
