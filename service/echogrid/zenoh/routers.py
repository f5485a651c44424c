"""Endpoints that the service connects to, and whether it is: Zenoh tries them for ever, and says nothing of it."""

from __future__ import annotations

import ipaddress
import logging
import re
from collections import Counter
from collections.abc import Iterable, Sequence

import zenoh

from echogrid.config.endpoint import PORTED

log = logging.getLogger("echogrid")
SAID = "publish.connect: %s is not connected: the service goes on, and publishes there as soon as it is"
Place = tuple[str, str, str]  # protocol, address, port; no address where a host's name stands for it, which Zenoh alone resolves


class Routers:
    """Remembers what the journal knows of each endpoint."""

    def __init__(self, session: zenoh.Session, endpoints: Sequence[str]) -> None:
        self._session = session
        self._endpoints = endpoints
        self._known: dict[str, bool] = {}

    def missing(self) -> tuple[str, ...]:
        """A reason for each that has no link now; the journal is told of changes. For one thread."""
        if not self._endpoints:
            return ()
        linked = linked_of(self._endpoints, [link.dst for link in self._session.info.links()])
        for name, up in linked.items():
            if up and self._known.get(name) is not True:
                log.info("publish.connect: %s is connected", name)
            elif not up and self._known.get(name) is not False:
                log.warning(SAID, name)
        self._known = linked
        return tuple(SAID % name for name, up in linked.items() if not up)


def linked_of(endpoints: Iterable[str], links: Iterable[str]) -> dict[str, bool]:
    """Whether each endpoint has one of the links, by where these lead. Names of hosts with one port cannot be told apart: they are one
    entry, and linked if there are as many links."""
    places: dict[Place, list[str]] = {}
    for endpoint in dict.fromkeys(endpoints):
        places.setdefault(place_of(endpoint), []).append(endpoint)
    count: Counter[Place] = Counter()
    for protocol, address, port in map(place_of, links):
        count[(protocol, address, port) if (protocol, address, port) in places else (protocol, "", port)] += 1
    return {" or ".join(f"'{name}'" for name in names): count[place] >= len(names) for place, names in places.items()}


def place_of(endpoint: str) -> Place:
    """Where an endpoint leads, or the end of a link."""
    protocol, _, address = endpoint.partition("/")
    address = re.split("[?#]", address, maxsplit=1)[0]
    if protocol not in PORTED:
        return protocol, address, ""
    host, _, port = address.rpartition(":")
    try:
        return protocol, str(ipaddress.ip_address(host.strip("[]").partition("%")[0])), str(int(port))
    except ValueError:
        return protocol, "", port
