"""From frames to the map: the thread that maps, how far it is behind the buses, and what it hands on to be published."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from echogrid.can.frame_queue import Item
from echogrid.can.intake.frames import FrameBatch
from echogrid.config.tables import Publish
from echogrid.core.mapper import MapUpdate
from echogrid.core.messages import PoseFix
from echogrid.core.trust.watch import State
from echogrid.live.receiving import Receiving
from echogrid.pipeline import Pipeline
from echogrid.threads import WAIT
from echogrid.topics.announcer import Snapshot, Snapshots

NS = 1e-9
MOST_LAG = 1.0  # s behind the buses, beyond which the newest map is old
ASKS = 0.05  # s: to ask all topics whether somebody takes them costs as much as a look at the bus
LATENCIES = 512  # of the newest map updates

Take = Callable[[FrameBatch, NDArray[np.int64]], Iterator[tuple[int, MapUpdate | None]]]


class Mapping:
    """Remembers how long frames waited and when the map was changed last. One thread runs `run`; any may ask.

    `take` takes frames to the pipeline; `receiving` has them. `settings` may be exchanged while it runs,
    `poses` (what came over Zenoh) and `listened` (whether anybody takes the map now) before.
    """

    def __init__(self, pipeline: Pipeline, take: Take, receiving: Receiving) -> None:
        self.pipeline = pipeline
        self.settings: Publish = pipeline.config.publish
        self.lock = threading.Lock()  # held by the mapping while it changes the map, by others for one tile's copy at a time
        self.outbox = Outbox()
        self.poses: Callable[[], Iterable[PoseFix]] = tuple
        self.listened: Callable[[], bool] = lambda: True
        self._take = take
        self._receiving = receiving
        self._snapshots = Snapshots()
        self._mapped_at = time.monotonic()  # when the newest frame was processed: a lag is latency, not silence
        self._lag = 0.0  # s, from that frame's receipt to then
        self._looped_at = time.monotonic()  # when the mapping loop last ran
        self._asked_at = -ASKS  # when it last asked whether anybody listens
        self._heard = False  # and what it was told
        self._latencies: deque[float] = deque(maxlen=LATENCIES)  # s, from a frame's receipt to the map update that it ended

    def run(self, stop: threading.Event, tap: Callable[[str, can.Message], None] | None = None) -> None:
        """Until `stop` is set. `tap` is given every frame before it is mapped."""
        while not stop.is_set():
            items = self._receiving.look(WAIT)
            self._looped_at = time.monotonic()
            self._catch_up(idle=not items)
            if not items:
                continue
            if tap is not None:
                for bus, batch, _ in items:
                    for message in batch:
                        tap(bus, message)
            batch, buses = self._together(items)
            steps = self._take(batch, buses)
            while self._step(steps, batch, items):
                pass
            now = self._mapped_at = self._looped_at = time.monotonic()
            self._lag = now - items[0][2]
            newest_ns = self.pipeline.signals.newest_ns
            if newest_ns is not None:
                expected_ns = self.pipeline.mapper.gathering.expected_ns
                self._receiving.pace.mapped(newest_ns * NS, items[-1][2], expected_ns * NS)

    def _together(self, items: list[Item]) -> tuple[FrameBatch, NDArray[np.int64]]:
        """All frames (N,) and their buses (N,); those of several buses in the order of their times."""
        numbers = [self.pipeline.signals.number(bus) for bus, _, _ in items]
        batch, which = FrameBatch.joined([batch for _, batch, _ in items], by_time=len(set(numbers)) > 1)
        return batch, np.array(numbers)[which]

    def _step(self, steps: Iterator[tuple[int, MapUpdate | None]], batch: FrameBatch, items: list[Item]) -> bool:
        """Maps up to the end of a cycle; False where there was none any more."""
        with self.lock:
            for fix in self.poses():
                self.pipeline.mapper.on_pose(fix)
            ended = next(((taken, update) for taken, update in steps if update is not None), None)
            if ended is None:
                return False
            taken, update = ended
            now = time.monotonic()
            self._latencies.append(now - self._receiving.pace.came_at(float(batch.stamps[taken - 1]), items[-1][2]))
            self._mapped_at, self._lag = now, now - items[0][2]
            snapshot = self._snapshots.take(self.pipeline.mapper, update, self.settings, listened=self._is_heard(now))
        if snapshot is not None:
            self.outbox.put(snapshot)
        return True

    def _catch_up(self, *, idle: bool) -> None:
        """Where nobody listened the newest map was not taken out: it is for who comes, and for who comes later where no newer one does."""
        if self._snapshots.left is None:
            return
        if not idle and not self._is_heard(self._looped_at):
            return
        with self.lock:
            snapshot = self._snapshots.late(self.pipeline.mapper, self.settings)
        if snapshot is not None:
            self.outbox.put(snapshot)

    def _is_heard(self, now: float) -> bool:
        """Whether anybody listens, or did ASKS ago."""
        if now - self._asked_at >= ASKS:
            self._asked_at, self._heard = now, self.listened()
        return self._heard

    def state(self) -> State:
        """Of the map, now. The traffic's own time continues by the monotonic clock, so that steps of other clocks do not matter."""
        state = self.pipeline.state(self._silence_ns())
        if self._lag > MOST_LAG and state.name in ("ok", "degraded"):
            return State("stale", (f"mapping: {self._lag:.1f} s behind the buses", *state.reasons))
        return state

    def pose(self) -> dict[str, Any] | None:
        """Of the poses from outside, now."""
        return self.pipeline.pose(self._silence_ns())

    def _silence_ns(self) -> int:
        """Since the newest frame was mapped."""
        return round((time.monotonic() - self._mapped_at) * 1e9)

    def latency_ms(self) -> dict[str, float | None]:
        """p50 and p99 of the newest updates, from the receipt of the frame that ended the cycle to the changed map; None: no update yet."""
        latencies = np.array(self._latencies) * 1e3
        p50, p99 = np.percentile(latencies, (50, 99)).tolist() if len(latencies) else (None, None)
        return {"p50": p50, "p99": p99}

    def loop_age(self) -> float:
        """s since the mapping loop last ran: it does so with or without frames."""
        return time.monotonic() - self._looped_at


class Outbox:
    """Room for one snapshot: a newer one replaces it."""

    def __init__(self) -> None:
        self._newest: Snapshot | None = None
        self._woken = False
        self._filled = threading.Condition()

    def put(self, snapshot: Snapshot) -> None:
        with self._filled:
            self._newest = snapshot
            self._filled.notify()

    def get(self, timeout: float) -> Snapshot | None:
        """The newest snapshot, once; None after `timeout` seconds, and when woken."""
        with self._filled:
            if self._newest is None and not self._woken:
                self._filled.wait(timeout)
            newest, self._newest = self._newest, None
            return newest

    def wake(self) -> None:
        """Nobody waits from now on."""
        with self._filled:
            self._woken = True
            self._filled.notify()
