"""Keeps what is learned of the car between two runs of the service."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

from echogrid.config.tables import Config
from echogrid.core.motion.error_filter import ErrorFilter
from echogrid.errors import EchogridError
from echogrid.store.learned_file import car_of, keep, recall

log = logging.getLogger("echogrid")
PERIOD = 60.0  # s between two writings: a car may lose power at any time


class LearnedKeeper:
    """Remembers the file as it was left, and whether it could be written.

    Without it mapping only learns anew, so nothing about it ends the service. A file that cannot be read, came after the start or was
    written by another service is left as it is; once it is moved away, a new one is made.
    """

    def __init__(self, path: Path, config: Config, errors: ErrorFilter, lock: threading.Lock) -> None:
        """Recalls what an earlier run has kept, if the configuration is still the same. `lock` is held by who changes `errors`."""
        self.path = path
        self.errors = errors
        self.lock = lock
        self.car = car_of(config)
        self._fails = False
        self._left = _version(path)
        try:
            kept = recall(path, self.car, len(errors.keep().mean))
        except EchogridError as error:
            log.warning("%s; the service begins without it, and keeps nothing there meanwhile", error)
            self._left, kept = None, None
        if kept is not None:
            with lock:
                errors.recall(kept)
            log.info("what earlier drives have taught of the car is used: %s", path)

    def run(self, stop: threading.Event) -> None:
        """Writes every PERIOD. What a drive teaches at its end is written by who ends it."""
        while not stop.wait(PERIOD):
            self.write()

    def write(self) -> None:
        """Raises nothing: mapping continues without, and the first failure is logged."""
        with self.lock:
            kept = self.errors.keep()
        try:
            if _version(self.path) not in (None, self._left):
                raise EchogridError(f"{self.path}: is not as this service left it, so what is learned of the car is not kept there")
            keep(self.path, self.car, kept)
            self._left = _version(self.path)
        except EchogridError as error:
            if not self._fails:
                log.warning("%s", error)
            self._fails = True
        else:
            self._fails = False


def _version(path: Path) -> tuple[int, int] | None:
    """Which file is there, written when; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns
