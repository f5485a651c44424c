"""What the journal and the service manager are told about the running service."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

from echogrid.core.trust.watch import State
from echogrid.topics.diagnostics import OUTSIDE, about
from echogrid.watching.systemd import Notifier

log = logging.getLogger("echogrid")
TURNING = 1.0  # s within which the mapping loop has to run for the watchdog


class Manager:
    """Remembers the state and the namesake that the journal knows. The watchdog is fed by maps that were published; if none was due,
    because no scan could be placed, by the mapping loop."""

    def __init__(self, loop_age: Callable[[], float]) -> None:
        """`loop_age`: for how many seconds the mapping loop has not run."""
        self.notifier = Notifier()
        self._loop_age = loop_age
        self._logged: State | None = None
        self._logged_at = time.monotonic()
        self._namesake: tuple[str, ...] = ()

    def map_published(self) -> None:
        self.notifier.alive()

    def tell(self, status: dict[str, Any]) -> None:
        """The journal of a change of state, the service manager of state and rates."""
        state, now = State(status["state"], status["reasons"]), time.monotonic()
        if self._logged is None or state.name != self._logged.name:
            before = "" if self._logged is None else f" after {now - self._logged_at:.0f} s {self._logged.name}"
            level = logging.INFO if state.name == "ok" or self._logged is None else logging.WARNING  # at the start there is no map yet
            own = (reason for reason in state.reasons if not any(about(part, (reason,)) for part in OUTSIDE))  # those have their own lines
            log.log(level, "; ".join((f"state {state.name}{before}", *own)))  # a sentence of its own, no repeat to be silenced
            self._logged, self._logged_at = state, now
        namesake = tuple(reason for reason in state.reasons if reason.startswith("vehicle: "))
        if namesake != self._namesake:
            log.log(*(logging.WARNING, namesake[0]) if namesake else (logging.INFO, "vehicle: no other service has its name any more"))
            self._namesake = namesake
        rates = status["rates"]
        texts = (f"{state.name}", f"{rates['map_hz']:.1f} maps/s, {rates['frames_hz']:.0f} frames/s", *state.reasons)
        self.notifier.status("; ".join(texts))
        if rates["map_hz"] == 0 and self._loop_age() < TURNING:
            self.notifier.alive()
