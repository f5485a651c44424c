"""The newest map as a file, for what comes after the service: systemd keeps its StateDirectory over restarts."""

from __future__ import annotations

import logging
import threading
import time
from pathlib import Path

from echogrid.core.tiled_map import LogOdds
from echogrid.io.map_files import write_npz

log = logging.getLogger("echogrid")
PERIOD = 30.0  # s
WAIT = 0.1  # s


class MapKeeper:
    """One thread takes maps over, another one writes them. A disk that is full or read-only is counted, said once, and tried again."""

    def __init__(self, folder: str | None, cell: float) -> None:
        """`folder`: None keeps nothing. `cell`: m."""
        self.path = None if folder is None else Path(folder) / "map.npz"
        self.cell = cell
        self.written = self.failed = 0
        self._due_at = time.monotonic() + PERIOD
        self._taken = threading.Event()
        self._map: tuple[int, int, LogOdds] | None = None

    def due(self) -> bool:
        """Whether it is time to `take` another map."""
        return self.path is not None and time.monotonic() >= self._due_at

    def take(self, row: int, column: int, log_odds: LogOdds) -> None:
        """A map (H, W) and the row and column of its first cell, to be written soon. Never waits."""
        self._due_at = time.monotonic() + PERIOD
        self._map = (row, column, log_odds)
        self._taken.set()

    def run(self, stop: threading.Event) -> None:
        """Writes what was taken; after `stop` what is left, and returns."""
        while not stop.is_set() or self._taken.is_set():
            if self._taken.wait(WAIT):
                self._taken.clear()
                self._write()

    def _write(self) -> None:
        if self.path is None or self._map is None:
            return
        row, column, log_odds = self._map
        try:
            write_npz(self.path, log_odds, (column * self.cell, row * self.cell), self.cell)
            self.written += 1
        except OSError as error:
            if not self.failed:
                log.warning("%s: cannot be written: %s; mapping goes on", self.path, error.strerror)
            self.failed += 1
