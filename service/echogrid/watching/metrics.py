"""Where monitoring finds the status as metrics: at an HTTP endpoint, in a file for node_exporter's textfile collector, or nowhere."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from contextlib import ExitStack
from importlib.util import find_spec
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from echogrid.config import tables as config
from echogrid.errors import EchogridError

if TYPE_CHECKING:  # it needs prometheus-client, which is an extra
    from echogrid.watching.openmetrics import Exposition

log = logging.getLogger(__name__)


class Metrics:
    """Serves and writes what [metrics] asks for, from construction to the end of `with`. One thread calls `update`.

    Raises EchogridError naming the key if the address or the file cannot be used, or if prometheus-client is not installed.
    """

    def __init__(self, settings: config.Metrics, vehicle: str) -> None:
        self._file = settings.file
        self._exposition: Exposition | None = None
        self._open = ExitStack()
        check_installed(settings)
        address = settings.address()
        if address is None and settings.file is None:
            return
        from echogrid.watching.openmetrics import Exposition

        self._exposition = Exposition(vehicle)
        if settings.file is not None:
            try:
                self._exposition.write(settings.file)
            except OSError as error:
                raise EchogridError(f"metrics.file: '{settings.file}' cannot be written: {error.strerror}") from error
        if address is not None:
            try:
                self._open.callback(self._exposition.serve(*address))
            except OSError as error:
                raise EchogridError(f"metrics.listen: '{settings.listen}' cannot be listened on: {error.strerror}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._open.close()

    def update(self, status: Mapping[str, Any]) -> None:
        """The status from now on. A file that cannot be written any more is a warning, for the map matters more."""
        if self._exposition is None:
            return
        self._exposition.update(status, time.time())
        if self._file is not None:
            try:
                self._exposition.write(self._file)
            except OSError as error:
                log.warning("metrics.file: '%s' cannot be written: %s", self._file, error.strerror)


def check_installed(settings: config.Metrics) -> None:
    """Raises EchogridError where metrics are asked for, but prometheus-client is not there."""
    if (settings.listen is not None or settings.file is not None) and find_spec("prometheus_client") is None:
        raise EchogridError("metrics: prometheus-client is not installed: pip install prometheus-client")
