"""What is shown, for each viewer: a running service to all at once, a recording to each at its own time, a stored map as it is."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable
from functools import partial
from typing import Protocol

from echogrid.errors import EchogridError
from echogrid.viewing.live_feed import LiveFeed
from echogrid.viewing.recorded import DriveFeed, McapFeed
from echogrid.viewing.scene import Frames, Scene
from echogrid.viewing.tape import Tape, newest
from echogrid.viewing.viewer import Viewer
from echogrid.viewing.wire import Kind, document

TICK = 0.2  # s: so often a page is told where its recording is
FAR = 4.0  # s of a recording beyond which it is begun anew instead of being played on
FIRST = 0.05  # s between two looks whether there is something on a tape at all


class Show(Protocol):
    """One for all viewers."""

    def work(self, stop: threading.Event) -> None:
        """In a thread of its own, until `stop` or until there is nothing left to do. Raises EchogridError."""

    async def watch(self, viewer: Viewer) -> None:
        """For one viewer, without end. Raises what Viewer.run raises."""


class LiveShow:
    """Remembers who watches."""

    def __init__(self, feed: LiveFeed) -> None:
        self.feed = feed
        self.viewers: set[Viewer] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    def work(self, stop: threading.Event) -> None:
        self.feed.run(stop, self._send)

    async def watch(self, viewer: Viewer) -> None:
        self._loop = asyncio.get_running_loop()
        await asyncio.to_thread(self._join, viewer)
        try:
            await viewer.run()
        finally:
            self.viewers.discard(viewer)

    def _join(self, viewer: Viewer) -> None:
        with self.feed.lock:  # what comes later is sent behind it
            self._call(partial(self._add, viewer, self.feed.scene.whole()))

    def _add(self, viewer: Viewer, frames: Frames) -> None:
        viewer.put(frames)
        self.viewers.add(viewer)

    def _send(self, frames: Frames) -> None:
        self._call(partial(self._put, frames))

    def _put(self, frames: Frames) -> None:
        for viewer in self.viewers:
            viewer.put(frames)

    def _call(self, what: Callable[[], None]) -> None:
        """In the event loop, one after the other."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # it has ended
                self._loop.call_soon_threadsafe(what)


class TapeShow:
    """Each viewer is at a place of its own, and may be ahead of nothing but the tape's end."""

    def __init__(self, feed: DriveFeed | McapFeed) -> None:
        self.feed = feed

    def work(self, stop: threading.Event) -> None:
        try:
            self.feed.run(stop)
        except EchogridError as error:
            self.feed.tape.failure, self.feed.tape.done = str(error), 1.0  # no more comes
            raise

    async def watch(self, viewer: Viewer) -> None:
        tape, loop = self.feed.tape, asyncio.get_running_loop()
        at, told, done = 0.0, 0.0, 0  # s of the drive; when the page was told of it; entries that it has
        if tape.empty:
            await viewer.send(self.feed.begin)
        while tape.empty:
            await viewer.send([_clock(tape, 0.0, viewer)])
            await asyncio.sleep(FIRST if tape.failure is None else TICK)
        last = loop.time()
        while True:
            now = loop.time()
            if viewer.seek is not None:
                at, viewer.seek, told = min(max(viewer.seek, 0.0), tape.end), None, 0.0
            elif viewer.playing:
                at = min(at + (now - last) * viewer.speed, tape.end)
            last, count = now, tape.count(at)
            due = tape.next_at(done)
            if count < done or not done or (due is not None and at - due > FAR * max(viewer.speed, 1.0)):
                frames, done = tape.whole_before(count)
                await viewer.send(frames)
            if count > done:
                await viewer.send(newest(tape.between(done, count)))
                done = count
            if now - told >= TICK:
                told = now
                await viewer.send([_clock(tape, at, viewer)])
            due = tape.next_at(done)
            pause = TICK if due is None or not viewer.playing else min(max((due - at) / viewer.speed, 0.005), TICK)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(viewer.asked.wait(), pause)
            if viewer.asked.is_set():
                viewer.asked.clear()
                told = 0.0


class MapShow:
    """A stored map."""

    def __init__(self, scene: Scene) -> None:
        self._frames = scene.whole()

    def work(self, stop: threading.Event) -> None:
        """There is nothing to do."""

    async def watch(self, viewer: Viewer) -> None:
        await viewer.send(self._frames)
        await asyncio.Event().wait()


def _clock(tape: Tape, at: float, viewer: Viewer) -> bytes:
    ended = at >= tape.end and tape.done >= 1.0
    said = {
        "at": round(at, 3),
        "end": round(tape.end, 3),
        "begun_s": tape.begun_ns * 1e-9,
        "done": round(tape.done, 3),
        "playing": viewer.playing and not ended,
        "speed": viewer.speed,
        "failure": tape.failure,
    }
    return document(Kind.CLOCK, said)
