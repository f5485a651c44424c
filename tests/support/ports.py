"""Where a test may listen."""

from __future__ import annotations

import random
import socket

PORTS = range(10_000, 32_000)  # below those that Linux gives to connections, so that none of them takes a port before the test does
CHANCE = random.SystemRandom()


def free_port() -> int:
    """On the loopback; nobody has it now."""
    while True:
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", CHANCE.choice(PORTS)))
            except OSError:
                continue
            return int(probe.getsockname()[1])
