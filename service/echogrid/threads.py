"""Threads that start together; the first one that fails ends all."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

WAIT = 0.1  # s: a thread looks this often whether it is to end


class Workers:
    """Threads that run until `stop` is set. What the first that fails raises is kept in `failure` and sets `stop`: none continues without
    it."""

    def __init__(self) -> None:
        self.stop = threading.Event()
        self.failure: Exception | None = None
        self._threads: list[threading.Thread] = []
        self._wakes: list[Callable[[], None]] = []

    def add(self, name: str, run: Callable[[threading.Event], None], wake: Callable[[], None] | None = None) -> None:
        """To be started by `with`: `run` ends soon after the event it is given is set, and `wake`, if it waits for something else, was
        called."""
        self._threads.append(threading.Thread(target=self._run, args=(run,), name=name))
        if wake is not None:
            self._wakes.append(wake)

    def fail(self, error: Exception) -> None:
        """Ends all, for this reason, if there was none before: what fails while all end is mostly a consequence."""
        self.failure = self.failure or error
        self.stop.set()

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Ends all and waits for them."""
        self.stop.set()
        for wake in self._wakes:
            wake()
        for thread in self._threads:
            thread.join()

    def _run(self, run: Callable[[threading.Event], None]) -> None:
        try:
            run(self.stop)
        except Exception as error:  # not a fault of a bus, a disk, a subscriber or a query: each part survives those
            self.fail(error)
