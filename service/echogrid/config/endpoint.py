"""Endpoints of Zenoh, `PROTOCOL/ADDRESS`: what is wrong with one, as the end of a sentence that begins with it."""

from __future__ import annotations

import difflib
import ipaddress
import re

from echogrid.config.tables import Publish

EXAMPLE = "tcp/127.0.0.1:7447"
PORTED = ("tcp", "tls", "udp", "quic", "ws")  # protocols whose address is HOST:PORT
OTHERS = ("unixsock-stream", "unixpipe", "vsock", "serial")


def nowhere(endpoint: str) -> str | None:
    """Where it leads, if anywhere: Zenoh takes what follows and tries in vain for ever. None where nothing is wrong."""
    protocol, slash, address = endpoint.partition("/")
    if not slash:
        return f"has no protocol, expected one such as '{EXAMPLE}'"
    if protocol in OTHERS:
        return None
    if protocol not in PORTED:
        near = difflib.get_close_matches(protocol, PORTED, n=1)
        return f"has the protocol '{protocol}', expected one such as '{EXAMPLE}'" + (f"; did you mean '{near[0]}'?" if near else "")
    host, _, port = re.split("[?#]", address, maxsplit=1)[0].rpartition(":")
    if not re.fullmatch("[0-9]+", port) or (host.startswith("[") and not host.endswith("]")):
        return f"has no port, expected one such as '{EXAMPLE}'"
    if not 1 <= int(port) <= 65535:
        return f"has the port {port}, expected one from 1 to 65535"
    return None if host else f"has no host, expected one such as '{EXAMPLE}'"


def exposed(endpoint: str, publish: Publish) -> str | None:
    """What is wrong with its protection, or None."""
    if publish.tls is not None:
        return None if endpoint.startswith("tls/") else "found beside [publish.tls], expected tls/HOST:PORT: others have no certificate"
    if endpoint.startswith("tls/"):
        return "found, expected [publish.tls] with it"
    if publish.plaintext or stays_here(endpoint):
        return None
    return "leaves this machine unprotected, expected tls/HOST:PORT and [publish.tls], or plaintext = true on a trusted network"


def stays_here(endpoint: str) -> bool:
    """Whether nobody reaches it from another machine."""
    protocol, _, address = endpoint.partition("/")
    host = address.rpartition(":")[0].strip("[]")
    try:
        return protocol == "unixsock-stream" or host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:  # a name, or nothing that Zenoh knows
        return False
