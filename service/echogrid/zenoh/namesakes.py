"""Other services of the same vehicle's name: what subscribers get of two is mixed, and neither knows it from its own map."""

from __future__ import annotations

import math
import time

import zenoh

from echogrid.topics.topic import RUN

PERIOD = 5.0  # s: asked again and again: with a standing subscription a thread of Zenoh 1.10.2 panicked more often
ANSWER = 5.0  # s: a router that does not answer has forgotten us by then
SAID = "vehicle: another service publishes as '{}' too, so subscribers get both maps by turns: give each its own `vehicle`"


class Namesakes:
    """Remembers which other services answered last, and shows ours: a liveliness token for each run of a service."""

    def __init__(self, session: zenoh.Session, of_vehicle: str, gid: bytes, *, asks: bool) -> None:
        """`of_vehicle`: what the vehicle's keys begin with; `gid`: names our run; `asks`: there are routers to be asked."""
        self._liveliness, self._all = session.liveliness(), f"{of_vehicle}/{RUN}/*"
        self._own = f"{of_vehicle}/{RUN}/{gid.hex()}"
        self._token = self._liveliness.declare_token(self._own)
        self._found: set[str] = set()
        self._others = 0
        self._ask_at = 0.0 if asks else math.inf
        self._replies: zenoh.Handler[zenoh.Reply] | None = None

    def others(self) -> int:
        """How many there are, as far as the routers know that we connect to; waits for nothing. For one thread."""
        if self._replies is None:
            if time.monotonic() >= self._ask_at:
                self._ask_at = time.monotonic() + PERIOD
                self._replies = self._liveliness.get(self._all, handler=zenoh.handlers.DefaultHandler(), timeout=ANSWER)
            return self._others
        try:
            while (reply := self._replies.try_recv()) is not None:
                if reply.ok is not None:
                    self._found.add(str(reply.ok.key_expr))
        except zenoh.ZError:  # all have answered
            self._others = len(self._found - {self._own})
            self._found.clear()
            self._replies = None
        return self._others
