"""A drive that is published from a thread of its own, as `echogrid replay --publish` does."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.support import world
from tests.support.waiting import until

from echogrid.commands.showing.publish import publish
from echogrid.live.service import Service
from echogrid.logs.drive import find_drive


def published_drive(folder: Path, endpoint: str, seconds: float, *, lost_after: float | None = None) -> Path:
    """A drive past a wall and a car that comes towards us; `lost_after`: s until the front right radar falls silent."""
    wall = world.standing([(x * 0.3, 6.0) for x in range(-20, 200)])
    other = world.moving(world.rectangle(60.0, 3.0), (-5.0, 0.0))
    messages = world.record(world.circle(6.0, 0.05), [wall, world.standing(world.rectangle(12, -5)), other], seconds)
    if lost_after is not None:
        end, front_right = 100 + lost_after, range(0x310, 0x320)
        messages = [message for message in messages if message.timestamp < end or message.arbitration_id not in front_right]
    return world.write_drive(folder, messages, world.CONFIG + f'\n[publish]\nlisten = ["{endpoint}"]\n')


class Playing:
    """What the thread did."""

    def __init__(self) -> None:
        self.service: Service | None = None
        self.summary: dict[str, Any] = {}
        self.ended = threading.Event()


@contextmanager
def playing(drive: Path, out: Path, speed: float, model: str | None = None) -> Iterator[Playing]:
    """Begins with the service, ends with the drive, or early with the block."""
    run = Playing()

    def start(service: Service) -> None:
        run.service = service

    def work() -> None:
        try:
            run.summary = publish(find_drive(drive, None), out, speed=speed, model=model, on_start=start)
        finally:
            run.ended.set()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        until(lambda: run.ended.is_set() or (run.service is not None and run.service.live.is_set()))
        yield run
    finally:
        if run.service is not None:
            run.service.workers.stop.set()
        thread.join(120)
    assert not thread.is_alive()
