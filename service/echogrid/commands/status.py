"""`echogrid status`: a look at a running service, or one after the other."""

from __future__ import annotations

import logging
import signal
import threading
import time
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

from echogrid.client import Client, Credentials, vehicles
from echogrid.commands.terminal import screen
from echogrid.errors import EchogridError
from echogrid.watching import status_text

log = logging.getLogger("echogrid")
PATIENCE = 5.0  # s: a status comes once a second, a connection may take some
SILENT = 2.5  # s without a status: two of them did not come


def command(endpoint: str, vehicle: str | None, tls: tuple[Path, Path, Path] | None, *, going_on: bool, as_json: bool) -> bool:
    """Whether the state is ok. `tls`: CA, certificate and key. `going_on`: until Ctrl-C, a KeyboardInterrupt.

    `vehicle`: None for the only one at the endpoint. Raises EchogridError.
    """
    view = status_text.as_json if as_json else status_text.lines
    credentials = Credentials(*tls) if tls else None
    vehicle = only_one(endpoint, credentials, wait=going_on) if vehicle is None else vehicle
    with Client(endpoint, vehicle, credentials) as client, screen(going_on, plain=as_json) as show:
        if going_on:
            interrupted = threading.Event()  # as an exception, Ctrl-C may be lost in a callback out of foreign code
            signal.signal(signal.SIGINT, lambda *_: interrupted.set())
            for document, seconds in watch(client):
                if interrupted.is_set():
                    raise KeyboardInterrupt
                if document is not None:
                    show(view(document, client.vehicle))
                elif not as_json:
                    show(status_text.silence(client.vehicle, seconds))
        document = look(client, credentials)
        show(view(document, client.vehicle))
        if (runs := len(client.runs())) > 1:
            log.warning(
                f"{runs} services publish as vehicle '{client.vehicle}': this status is of one of them; give each its own `vehicle`"
            )
    return document.get("state") == "ok"


def only_one(endpoint: str, credentials: Credentials | None, *, wait: bool) -> str:
    """The vehicle at an endpoint; `wait`: until there is one. Raises EchogridError where there is none, or more than one."""
    for tries in count():
        if found := vehicles(endpoint, credentials, PATIENCE):
            break
        if not wait:
            raise EchogridError(f"{endpoint}: no vehicle within {PATIENCE:.0f} s, expected a service that listens there")
        if not tries:
            log.info(f"{endpoint}: no vehicle within {PATIENCE:.0f} s; waiting for a service that listens there")
    if len(found) > 1:
        raise EchogridError(f"{endpoint}: the vehicles {', '.join(found)} are there, expected one: say which with --vehicle")
    return found[0]


def look(client: Client, credentials: Credentials | None) -> dict[str, Any]:
    """The next status. Raises EchogridError where none comes, with the vehicles that are there."""
    document = client.status(PATIENCE)
    if document is None:
        found = vehicles(client.endpoint, credentials, 1.0)
        others = f"; there are: {', '.join(found)}" if found else ""
        where = f"vehicle '{client.vehicle}' at {client.endpoint}"
        raise EchogridError(f"{where}: no status within {PATIENCE:.0f} s, expected a service that listens there for this vehicle{others}")
    return document


def watch(client: Client) -> Iterator[tuple[dict[str, Any] | None, float]]:
    """Each status as it comes, or None where none does, and for how many seconds none has come. Without end."""
    heard = time.monotonic()
    while True:
        document = client.status(SILENT)
        heard = heard if document is None else time.monotonic()
        yield document, time.monotonic() - heard
