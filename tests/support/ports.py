"""Where a test may listen."""

from __future__ import annotations

import socket


def free_port() -> int:
    """On the loopback; nobody has it now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
