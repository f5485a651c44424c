"""The page's files and its WebSocket over HTTP: who may come is in `doors`, what they see in `shows`."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable
from importlib.resources import files

import msgspec
from aiohttp import WSCloseCode, WSMsgType, web

from echogrid.errors import EchogridError
from echogrid.viewing.doors import Door
from echogrid.viewing.shows import Show
from echogrid.viewing.viewer import TOO_SLOW, Asked, TooSlowError, Viewer

log = logging.getLogger("echogrid")
MOST_VIEWERS = 32
LONGEST = 1024  # characters of a message from the page
MOST_BYTES = 1 << 16  # of one that is looked at at all
FIRST_WORD = 5.0  # s for it
HEARTBEAT = 20.0  # s
NO_TOKEN = 4401  # our own close code: the page asks for the token
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
    "Server": "echogrid",
}


def page_files() -> dict[str, bytes]:
    """All files of the page by their path on the server; there is nothing else, whatever path is asked for."""
    folder = files("echogrid.viewing") / "page"
    found = {f"/{entry.name}": entry.read_bytes() for entry in folder.iterdir() if "." in entry.name}
    return {**found, "/": found["/index.html"]}


class PageServer:
    """Remembers who watches. All of it runs in one event loop, beside the show's own thread."""

    def __init__(self, show: Show, door: Door) -> None:
        self.show = show
        self.door = door
        self.viewers: set[Viewer] = set()
        self._files = page_files()

    async def serve(self, stop: asyncio.Event, ready: Callable[[int], None]) -> None:
        """Until `stop`; `ready` is told the port once the page can be opened. Raises EchogridError where the address cannot be had."""
        application = web.Application(client_max_size=LONGEST)
        application.on_response_prepare.append(_dress)
        application.router.add_get("/socket", self._socket)
        application.router.add_get("/{path:.*}", self._file)
        # What strangers send is no fault of ours: aiohttp's own words about it would be tracebacks.
        runner = web.AppRunner(
            application, access_log=None, logger=logging.getLogger("echogrid.http"), handle_signals=False, shutdown_timeout=1
        )
        await runner.setup()
        site = web.TCPSite(runner, self.door.host, self.door.port, ssl_context=self.door.tls)
        try:
            await site.start()
        except OSError as error:
            await runner.cleanup()
            where = f"{self.door.host}:{self.door.port}"
            raise EchogridError(f"--listen: {where} cannot be listened on: {error.strerror or error}") from error
        try:
            ready(int(runner.addresses[0][1]))
            await stop.wait()
            leaving = (viewer.dismiss("the server was stopped", WSCloseCode.GOING_AWAY) for viewer in list(self.viewers))
            await asyncio.gather(*leaving, return_exceptions=True)
        finally:
            await runner.cleanup()

    async def _file(self, request: web.Request) -> web.StreamResponse:
        refused = self.door.refusal(request.host, request.headers.get("Origin"))
        if refused is not None:
            return _refused(403, refused)
        body = self._files.get(request.raw_path.partition("?")[0])
        if body is None:
            return _refused(404, "there is no such page here, expected /")
        suffix = "." + request.path.rpartition(".")[2] if request.path != "/" else ".html"
        return web.Response(body=body, content_type=TYPES[suffix], charset="utf-8")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        refused = self.door.refusal(request.host, request.headers.get("Origin"))
        if refused is not None:
            return _refused(403, refused)
        socket = web.WebSocketResponse(max_msg_size=MOST_BYTES, heartbeat=HEARTBEAT, timeout=2.0, compress=False)
        if not socket.can_prepare(request).ok:
            return _refused(400, "this is not a WebSocket's request")
        await socket.prepare(request)
        viewer = Viewer(socket, request)
        if len(self.viewers) >= MOST_VIEWERS:
            await viewer.dismiss(f"{MOST_VIEWERS} viewers are here already, try again later")
            return socket
        self.viewers.add(viewer)
        try:
            await self._attend(socket, viewer)
        finally:
            self.viewers.discard(viewer)
        return socket

    async def _attend(self, socket: web.WebSocketResponse, viewer: Viewer) -> None:
        """From its first word to its end."""
        try:
            first = await asyncio.wait_for(self._next(socket), FIRST_WORD)
        except TimeoutError:
            await viewer.dismiss(f"said nothing for {FIRST_WORD:.0f} s", WSCloseCode.POLICY_VIOLATION)
            return
        except ValueError as error:
            await viewer.dismiss(str(error), WSCloseCode.POLICY_VIOLATION)
            return
        if first is None:
            return
        if not self.door.admits(first.token):
            await asyncio.sleep(0.5)  # who guesses guesses slowly
            await viewer.dismiss("the token is missing or wrong: open the address that `echogrid view` printed", NO_TOKEN)
            return
        viewer.hear(first)
        watching = asyncio.create_task(self.show.watch(viewer))
        listening = asyncio.create_task(self._listen(socket, viewer))
        try:
            await asyncio.wait((watching, listening), return_when=asyncio.FIRST_COMPLETED)
            if watching.done():
                await self._part(watching, viewer)
            elif (said := listening.exception()) is not None:
                await viewer.dismiss(str(said), WSCloseCode.POLICY_VIOLATION)
        finally:
            for task in (watching, listening):
                task.cancel()
                with contextlib.suppress(asyncio.CancelledError, Exception):
                    await task

    async def _part(self, watching: asyncio.Task[None], viewer: Viewer) -> None:
        try:
            await watching
        except TooSlowError:
            log.warning("a viewer was too slow and was dropped")
            await viewer.dismiss(TOO_SLOW)
        except (ConnectionError, RuntimeError):
            pass  # it is gone, or is going

    async def _listen(self, socket: web.WebSocketResponse, viewer: Viewer) -> None:
        """What the page asks for, until it goes. Raises ValueError for what no page of ours says."""
        while (asked := await self._next(socket)) is not None:
            viewer.hear(asked)

    async def _next(self, socket: web.WebSocketResponse) -> Asked | None:
        message = await socket.receive()
        if message.type is WSMsgType.TEXT:
            if len(message.data) > LONGEST:
                raise ValueError(f"not a word of this page: {len(message.data)} characters, expected at most {LONGEST}")
            try:
                return msgspec.json.decode(message.data, type=Asked)
            except (msgspec.DecodeError, RecursionError) as error:
                raise ValueError(f"not a word of this page: {error}") from error
        if message.type is WSMsgType.BINARY:
            raise ValueError("not a word of this page: binary")
        return None


def run_show(show: Show, stop: threading.Event, failed: Callable[[Exception], None]) -> threading.Thread:
    """The show's own thread, started; `failed` is told of what ends it."""

    def work() -> None:
        try:
            show.work(stop)
        except Exception as error:  # handed to whoever waits
            failed(error)

    thread = threading.Thread(target=work, name="show")
    thread.start()
    return thread


def _refused(status: int, sentence: str) -> web.Response:
    return web.Response(status=status, text=f"{sentence}\n")


async def _dress(_: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)
