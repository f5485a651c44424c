"""Waiting for facts. How long a busy machine takes over a thing says nothing about it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE = 180.0  # s: far beyond what anything here takes, and waited for in full only where it fails
AGAIN = 0.05  # s until what was sent is sent again

T = TypeVar("T")


def until(look: Callable[[], T | None], send: Callable[[], object] = lambda: None) -> T:
    """What `look` finds in the end: the first that is not None, False or empty. `send` comes before it and now and then again, for
    a subscription takes a moment to be known, and what is sent before that is lost."""
    deadline, due = time.monotonic() + PATIENCE, 0.0
    while True:
        now = time.monotonic()
        if now >= due:
            send()
            due = time.monotonic() + AGAIN
        if found := look():
            return found
        assert now < deadline, f"this did not come about within {PATIENCE:.0f} s"
        time.sleep(0.002)
