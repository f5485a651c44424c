"""`echogrid view`: the live page, and the server behind it, until Ctrl-C."""

from __future__ import annotations

import asyncio
import logging
import signal
import socket
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from echogrid.client import Credentials
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive
from echogrid.viewing.doors import Door, door

try:
    from echogrid.viewing.server import PageServer, run_show
    from echogrid.viewing.shows import LiveShow, MapShow, Show, TapeShow
except ImportError as missing:
    raise EchogridError("aiohttp is not installed: pip install aiohttp") from missing
from echogrid.viewing.live_feed import LiveFeed
from echogrid.viewing.recorded import DriveFeed, McapFeed
from echogrid.viewing.stored import SUFFIXES, stored_scene

log = logging.getLogger("echogrid")
EVERYWHERE = ("0.0.0.0", "::")


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be seen: `path`, or a running service."""

    path: Path | None
    config: Path | None
    model: str | None
    epoch: int | None
    endpoint: str
    vehicle: str | None  # None: the only one that is there
    tls: tuple[Path, Path, Path] | None


def command(wanted: Wanted, listen: tuple[str, int], token: Path | None, certificate: tuple[Path, Path] | None, *, plaintext: bool) -> None:
    """Until SIGINT or SIGTERM. Raises EchogridError."""
    entrance = door(listen, token, certificate, plaintext=plaintext)
    asyncio.run(_serve(show_of(wanted), entrance))


def show_of(wanted: Wanted) -> Show:
    """A folder or a log with a configuration is mapped, an MCAP file without one is shown as it was published, a stored map as it is."""
    path = wanted.path
    if path is None:
        _check_options(wanted, "a running service", ("vehicle", "tls"))
        credentials = Credentials(*wanted.tls) if wanted.tls else None
        return LiveShow(LiveFeed(wanted.endpoint, wanted.vehicle, credentials))
    if path.suffix in SUFFIXES and not path.is_dir():
        _check_options(wanted, "a stored map", ("epoch",))
        return MapShow(stored_scene(path, wanted.epoch))
    if path.suffix == ".mcap" and wanted.config is None:
        _check_options(wanted, "a recording as it was published (with -c it is mapped anew)", ())
        return TapeShow(McapFeed(path))
    _check_options(wanted, "a drive", ("config", "model"))
    return TapeShow(DriveFeed(find_drive(path, wanted.config), wanted.model))


def _check_options(wanted: Wanted, what: str, taken: Sequence[str]) -> None:
    """Raises EchogridError for an option that would change nothing of what is shown."""
    for name in ("config", "model", "epoch", "vehicle", "tls"):
        if name not in taken and getattr(wanted, name) is not None:
            raise EchogridError(f"--{name}: is not for {what}")


def demo_drive() -> Path:
    """The shipped one."""
    return Path(str(files("echogrid") / "demo_drive"))


async def _serve(show: Show, entrance: Door) -> None:
    loop, stop, ended = asyncio.get_running_loop(), asyncio.Event(), threading.Event()
    failures: list[Exception] = []

    def failed(error: Exception) -> None:
        if isinstance(error, EchogridError) and isinstance(show, TapeShow):
            log.error("%s", error)  # the page says so too, and what there is can be looked at
            return
        failures.append(error)
        loop.call_soon_threadsafe(stop.set)

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    thread = run_show(show, ended, failed)
    try:
        await PageServer(show, entrance).serve(stop, lambda port: print(f"open {address(entrance, port)}   (Ctrl-C ends it)", flush=True))
    finally:
        ended.set()
        await asyncio.to_thread(thread.join)
    if failures:
        raise failures[0]


def address(entrance: Door, port: int) -> str:
    """Where the page is; the token is behind the #, which browsers send to no server."""
    host = socket.gethostname() if entrance.host in EVERYWHERE else entrance.host
    host = f"[{host}]" if ":" in host else host
    scheme = "http" if entrance.tls is None else "https"
    return f"{scheme}://{host}:{port}/" + (f"#token={entrance.token}" if entrance.token else "")
