"""The server of the page, in a thread of this process, and one who watches over a plain WebSocket."""

from __future__ import annotations

import asyncio
import json
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection, connect

from echogrid.viewing.doors import Door
from echogrid.viewing.server import PageServer, run_show
from echogrid.viewing.shows import Show
from echogrid.viewing.wire import DTYPES, SIDE, Kind, Plane

OPEN = Door("127.0.0.1", 0, None, None)


@contextmanager
def served(show: Show, door: Door = OPEN) -> Iterator[tuple[PageServer, int]]:
    """The server and its port."""
    server, ended, ready = PageServer(show, door), threading.Event(), threading.Event()
    found: dict[str, Any] = {}

    async def main() -> None:
        found["loop"], found["stop"] = asyncio.get_running_loop(), asyncio.Event()

        def up(port: int) -> None:
            found["port"] = port
            ready.set()

        await server.serve(found["stop"], up)

    failures: list[Exception] = []
    thread = threading.Thread(target=lambda: asyncio.run(main()))
    thread.start()
    worker = run_show(show, ended, failures.append)
    try:
        assert ready.wait(60)
        yield server, found["port"]
    finally:
        found["loop"].call_soon_threadsafe(found["stop"].set)
        thread.join(60)
        ended.set()
        worker.join(60)
    assert not thread.is_alive()
    assert failures == []


@contextmanager
def watch(port: int, first: dict[str, Any] | None = None, **options: Any) -> Iterator[ClientConnection]:
    """A viewer that has said its first word."""
    with connect(f"ws://127.0.0.1:{port}/socket", **({"max_size": None, "compression": None, "open_timeout": 60} | options)) as viewer:
        viewer.send(json.dumps(first or {}))
        yield viewer


class Seen:
    """What a viewer has been told, put together by other code than the page's: whole cells in a dictionary."""

    def __init__(self) -> None:
        self.documents: dict[Kind, dict[str, Any]] = {}
        self.blocks: dict[tuple[Plane, int, int], np.ndarray] = {}
        self.pose: tuple[float, ...] | None = None
        self.points: tuple[int, np.ndarray, np.ndarray, np.ndarray] | None = None
        self.kinds: list[Kind] = []

    def take(self, frame: bytes) -> Kind:
        kind = Kind(frame[0])
        self.kinds.append(kind)
        if kind in (Kind.HELLO, Kind.STATUS, Kind.CLOCK):
            self.documents[kind] = json.loads(frame[4:])
        elif kind is Kind.RESET:
            self.blocks = {key: cells for key, cells in self.blocks.items() if key[0] is Plane.TRUTH}
        elif kind is Kind.BLOCKS:
            plane, count = Plane(frame[1]), struct.unpack_from("<H", frame, 2)[0]
            cells = np.frombuffer(frame, DTYPES[plane], offset=4 + 8 * count).reshape(count, SIDE, SIDE)
            for n in range(count):
                self.blocks[plane, *struct.unpack_from("<ii", frame, 4 + 8 * n)] = cells[n]
        elif kind is Kind.POSE:
            self.pose = struct.unpack_from("<q5d", frame, 8)
        elif kind is Kind.POINTS:
            count, stamp_ns = struct.unpack_from("<Iq", frame, 4)
            places = np.frombuffer(frame, "<f4", 2 * count, 16).reshape(count, 2)
            marks = np.frombuffer(frame, "u1", 2 * count, 16 + 8 * count)
            self.points = stamp_ns, places, marks[:count], marks[count:]
        return kind

    def cells(self, plane: Plane, row: int, column: int, height: int, width: int, empty: int) -> np.ndarray:
        """A part of the map, cell by cell."""
        out = np.full((height, width), empty, np.int64)
        for i in range(height):
            for j in range(width):
                block = self.blocks.get((plane, (row + i) // SIDE, (column + j) // SIDE))
                if block is not None:
                    out[i, j] = block[(row + i) % SIDE, (column + j) % SIDE]
        return out
