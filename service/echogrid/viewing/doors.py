"""Who may come in: where the page is served, and what a visitor has to show."""

from __future__ import annotations

import hmac
import ipaddress
import ssl
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from echogrid.errors import EchogridError
from echogrid.zenoh.credentials import show

LOOPBACK, PORT = "127.0.0.1", 8890
SHORTEST_TOKEN = 16  # characters
LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")


@dataclass(frozen=True, slots=True)
class Door:
    """An address, and what is asked of visitors there."""

    host: str
    port: int
    token: str | None
    tls: ssl.SSLContext | None

    @property
    def local(self) -> bool:
        """Whether only this machine can come."""
        return is_loopback(self.host)

    def refusal(self, host: str | None, origin: str | None) -> str | None:
        """What is wrong with a request's Host and Origin, in a sentence; None where nothing is.

        A page from elsewhere that a browser on this machine has open comes with its own origin, or, where it had its name point to this
        machine, with a foreign host.
        """
        name = _name(host)
        if name is None:
            return "the request names no host"
        if self.local and name not in (*LOCAL_NAMES, self.host):
            return f"this page is for this machine alone, and the request is for the host '{name[:80]}'"
        if origin is not None and _address(origin) != host:
            return f"the request comes from a page of '{origin[:80]}', expected one from here"
        return None

    def admits(self, token: object) -> bool:
        """Whether a visitor with this token may see the map."""
        if self.token is None:
            return True
        return isinstance(token, str) and hmac.compare_digest(token.encode(), self.token.encode())


def door(listen: tuple[str, int], token: Path | None, certificate: tuple[Path, Path] | None, *, plaintext: bool) -> Door:
    """Raises EchogridError for files that cannot be used, and where others could reach the page without both token and TLS.

    `token`: a file that holds it. `certificate`: PEM files, the certificate and its key.
    """
    host, port = listen
    if not is_loopback(host):
        missing = (["--token FILE"] if token is None else []) + (
            ["--certificate CERT KEY"] if certificate is None and not plaintext else []
        )
        if missing:
            hint = ", or --plaintext on a network of your own" if certificate is None and not plaintext else ""
            raise EchogridError(f"--listen: {host} can be reached from other machines, expected {' and '.join(missing)} with it{hint}")
    return Door(host, port, _token(token), _tls(certificate))


def is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _token(path: Path | None) -> str | None:
    if path is None:
        return None
    try:
        token = path.read_text().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise EchogridError(f"--token: {path}: cannot be read: {getattr(error, 'strerror', 'not a text')}") from error
    if len(token) < SHORTEST_TOKEN or not token.isascii() or not token.isprintable() or " " in token:
        raise EchogridError(f"--token: {path}: expected at least {SHORTEST_TOKEN} printable ASCII characters without spaces, on one line")
    return token


def _tls(certificate: tuple[Path, Path] | None) -> ssl.SSLContext | None:
    if certificate is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        show(context, *certificate)
    except EchogridError as error:
        raise EchogridError(f"--certificate: {error}") from error
    return context


def _address(origin: str) -> str | None:
    try:
        return urlsplit(origin).netloc
    except ValueError:
        return None


def _name(host: str | None) -> str | None:
    try:
        return urlsplit(f"//{host}").hostname if host else None
    except ValueError:
        return None
