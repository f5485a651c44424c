"""Other services of the same vehicle's name: what subscribers get of two is mixed, and neither knows it from its own map."""

from __future__ import annotations

import zenoh

from echogrid.topics.topic import RUN

SAID = "vehicle: another service publishes as '{}' too, so subscribers get both maps by turns: give each its own `vehicle`"


class Namesakes:
    """Remembers which other services are there, and shows ours: a liveliness token for each run of a service."""

    def __init__(self, session: zenoh.Session, of_vehicle: str, gid: bytes) -> None:
        """`of_vehicle`: what the vehicle's keys begin with; `gid`: names our run."""
        self._own, self._others = f"{of_vehicle}/{RUN}/{gid.hex()}", set[str]()
        self._token = session.liveliness().declare_token(self._own)
        self._subscriber = session.liveliness().declare_subscriber(f"{of_vehicle}/{RUN}/*", zenoh.handlers.DefaultHandler(), history=True)

    def others(self) -> int:
        """How many are there now, as far as they can be heard: at the routers that we connect to. For one thread."""
        while (sample := self._subscriber.try_recv()) is not None:
            name = str(sample.key_expr)
            if sample.kind == zenoh.SampleKind.DELETE:
                self._others.discard(name)
            elif name != self._own:
                self._others.add(name)
        return len(self._others)
