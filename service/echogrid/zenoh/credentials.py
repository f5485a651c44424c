"""A session's TLS files, which must fit each other before Zenoh relies on them."""

from __future__ import annotations

import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from echogrid.config.tables import Publish, Tls
from echogrid.errors import EchogridError


@dataclass(frozen=True, slots=True)
class Credentials:
    """PEM files: the certificate of the authority that both ends trust, our own certificate signed by it, and its private key."""

    ca: Path
    certificate: Path
    key: Path

    @classmethod
    def of(cls, tls: Tls) -> Self:
        """Those that a configuration names."""
        return cls(Path(tls.ca), Path(tls.certificate), Path(tls.key))

    def check(self) -> None:
        """Raises EchogridError where a file cannot be read or is something else, the key is another's, or the authority does not vouch for
        us now."""
        ends = [self._context(ssl.PROTOCOL_TLS_SERVER), self._context(ssl.PROTOCOL_TLS_CLIENT)]
        try:
            _handshake(*ends)
        except ssl.SSLCertVerificationError as error:
            raise EchogridError(f"{self.certificate}: is not accepted by {self.ca}: {error.verify_message}") from error
        except ssl.SSLError as error:
            raise EchogridError(f"{self.certificate}: cannot be used for TLS: {error.reason}") from error

    def zenoh(self) -> dict[str, object]:
        """Zenoh's transport/link/tls: both ends show a certificate, in either direction."""
        return {
            "root_ca_certificate": str(self.ca),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
            **{f"{way}_{what}": str(path) for way in ("listen", "connect") for what, path in self._own().items()},
        }

    def _own(self) -> dict[str, Path]:
        return {"certificate": self.certificate, "private_key": self.key}

    def _context(self, protocol: int) -> ssl.SSLContext:
        context = ssl.SSLContext(protocol)
        context.check_hostname = False
        context.verify_mode = ssl.CERT_REQUIRED
        _trust(context, self.ca)
        show(context, self.certificate, self.key)
        return context


def show(context: ssl.SSLContext, certificate: Path, key: Path) -> None:
    """From now on this is the certificate that we show. Raises EchogridError naming the file that cannot be read, or is another."""
    _trust(ssl.SSLContext(context.protocol), certificate)  # only to say which of the two it is
    try:
        key.read_bytes()
        context.load_cert_chain(certificate, key, password="")  # without a word it would ask the terminal for one
    except (ssl.SSLError, ValueError) as error:
        raise EchogridError(f"{key}: is not an unencrypted PEM key of the certificate {certificate}") from error
    except OSError as error:
        raise EchogridError(f"{key}: cannot be read: {error.strerror}") from error


def checked(settings: Publish) -> Credentials | None:
    """Those of [publish.tls]; None without. Raises EchogridError naming the table and the file, as `check`."""
    if settings.tls is None:
        return None
    credentials = Credentials.of(settings.tls)
    try:
        credentials.check()
    except EchogridError as error:
        raise EchogridError(f"publish.tls: {error}") from error
    return credentials


def _trust(context: ssl.SSLContext, certificate: Path) -> None:
    try:
        certificate.read_bytes()
        context.load_verify_locations(certificate)
    except ssl.SSLError as error:
        raise EchogridError(f"{certificate}: holds no certificate in PEM form") from error
    except OSError as error:
        raise EchogridError(f"{certificate}: cannot be read: {error.strerror}") from error


def _handshake(server: ssl.SSLContext, client: ssl.SSLContext) -> None:
    """Both ends in memory: the same verdict on chain, dates and purpose as on a network. Raises ssl.SSLError."""
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = [client.wrap_bio(down, up), server.wrap_bio(up, down, server_side=True)]
    waiting = True
    while waiting:
        waiting = False
        for end in ends:
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                waiting = True
