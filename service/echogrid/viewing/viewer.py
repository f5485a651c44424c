"""One who watches: what waits for them, what they ask for, and how they are told that they were too slow."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Iterable

import msgspec
from aiohttp import WSCloseCode, web

MOST_WAITING = 16 << 20  # bytes for one viewer
PATIENCE = 10.0  # s for the network to take one frame
FAREWELL = 2.0  # s for a viewer to take the reason of its end
TOO_SLOW = f"too slow: {MOST_WAITING >> 20} MiB or {PATIENCE:.0f} s were waiting; the page comes back by itself"


class Asked(msgspec.Struct, forbid_unknown_fields=True):
    """One message of the page."""

    token: str | None = None  # in the first one, where one is asked for
    playing: bool | None = None
    speed: float | None = None  # times the recording's own pace
    seek: float | None = None  # s from the recording's begin


class TooSlowError(Exception):
    """The viewer does not take what it is sent."""


class Viewer:
    """Remembers what is still to be sent. Used by the event loop alone."""

    def __init__(self, socket: web.WebSocketResponse, request: web.Request) -> None:
        self.asked = asyncio.Event()  # something that `playing`, `speed` or `seek` say is new
        self.playing, self.speed = True, 1.0
        self.seek: float | None = None
        self._socket = socket
        self._request = request
        self._waiting: deque[bytes] = deque()
        self._bytes = 0
        self._more = asyncio.Event()

    def hear(self, asked: Asked) -> None:
        """Takes over what the page asks for."""
        if asked.playing is not None:
            self.playing = asked.playing
        if asked.speed is not None:
            self.speed = min(max(asked.speed, 0.1), 64.0)
        if asked.seek is not None:
            self.seek = asked.seek
        self.asked.set()

    def put(self, frames: Iterable[bytes]) -> None:
        """To be sent by `run`; nobody waits for it."""
        for frame in frames:
            self._waiting.append(frame)
            self._bytes += len(frame)
        self._more.set()

    async def run(self) -> None:
        """Sends what was put. Raises TooSlowError, and ConnectionError where the viewer is gone."""
        while True:
            await self._more.wait()
            self._more.clear()
            while self._waiting:
                if self._bytes > MOST_WAITING:
                    raise TooSlowError
                frame = self._waiting.popleft()
                self._bytes -= len(frame)
                await self._send(frame)

    async def send(self, frames: Iterable[bytes]) -> None:
        """At once; the same errors."""
        for frame in frames:
            await self._send(frame)

    async def dismiss(self, why: str, code: int = WSCloseCode.TRY_AGAIN_LATER) -> None:
        """Tells why it ends, as far as the viewer takes it."""
        self._waiting.clear()
        with contextlib.suppress(TimeoutError, ConnectionError):
            await asyncio.wait_for(self._socket.close(code=code, message=why.encode()[:123]), FAREWELL)
        if self._request.transport is not None:
            self._request.transport.abort()

    async def _send(self, frame: bytes) -> None:
        try:
            await asyncio.wait_for(self._socket.send_bytes(frame), PATIENCE)
        except TimeoutError as error:
            raise TooSlowError from error
