"""What is published when."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import pytest

from echogrid.live import publishing
from echogrid.live.publishing import Publishing


def test_a_process_that_was_stopped_for_an_hour_does_not_make_up_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by a debugger, a container that was paused or a virtual machine: a status a second, before and after."""
    now, stop, told = [0.0], threading.Event(), list[float]()
    sleeps = iter([0.5, 0.5, 3600.0, *[0.5] * 6])

    def get(timeout: float) -> None:
        now[0] += next(sleeps, 0.0)
        if now[0] >= 3604.0:
            stop.set()

    announcer = SimpleNamespace(status=lambda status, stamp_ns, wanted: (), meta=lambda stamp_ns: None, about=dict)
    manager = SimpleNamespace(tell=lambda status: told.append(now[0]), map_published=lambda: None)
    monkeypatch.setattr(publishing, "time", SimpleNamespace(monotonic=lambda: now[0], time_ns=time.time_ns))
    service = Publishing(announcer, SimpleNamespace(get=get), dict[str, Any])  # type: ignore[arg-type]

    def measure(status: Mapping[str, Any]) -> None:
        pass

    service.run(stop, manager, measure)  # type: ignore[arg-type]
    assert told == [0.5, 1.0, 3601.0, 3602.0, 3603.0, 3604.0]
