"""What the journal and the service manager are told about the running service."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

from echogrid.core.trust.watch import State
from echogrid.watching.systemd import Notifier

log = logging.getLogger("echogrid")
TURNING = 1.0  # s within which the mapping loop has to run for the watchdog


class Manager:
    """Remembers the state that the journal knows. The watchdog is fed by maps that went out; where none had to, because no scan came that
    could be placed, by the mapping's coming round."""

    def __init__(self, turned: Callable[[], float]) -> None:
        """`turned`: for how many seconds the mapping loop has not run."""
        self.notifier = Notifier()
        self._turned = turned
        self._told: State | None = None
        self._told_at = time.monotonic()

    def map_went_out(self) -> None:
        self.notifier.alive()

    def tell(self, status: dict[str, Any]) -> None:
        """The journal of a change of state, the service manager of state and rates."""
        state, now = State(status["state"], status["reasons"]), time.monotonic()
        if self._told is None or state.name != self._told.name:
            before = "" if self._told is None else f" after {now - self._told_at:.0f} s {self._told.name}"
            level = logging.INFO if state.name == "ok" or self._told is None else logging.WARNING  # at the start there is no map yet
            log.log(level, "; ".join((f"state {state.name}{before}", *state.reasons)))  # a sentence of its own, no repeat to be silenced
            self._told, self._told_at = state, now
        rates = status["rates"]
        told = (f"{state.name}", f"{rates['map_hz']:.1f} maps/s, {rates['frames_hz']:.0f} frames/s", *state.reasons)
        self.notifier.status("; ".join(told))
        if rates["map_hz"] == 0 and self._turned() < TURNING:
            self.notifier.alive()
