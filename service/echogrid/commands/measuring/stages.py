"""A recording through the service's own chain, with the processor time of each stage. None is counted twice."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from echogrid.config.loading import load_config
from echogrid.errors import EchogridError
from echogrid.logs.drive import Drive
from echogrid.logs.log import Log
from echogrid.model.network import OnnxSensorModel
from echogrid.pipeline import Pipeline
from echogrid.topics.announcer import Announcer, Snapshots

Clock = Callable[[], float]
FRAMES, INFERENCE = "frames to scans and motion", "network"
PUBLISHING = ("window to publish", "messages to publish")
WARM = 20  # updates that are not counted
# Of the mapper: method by method, in the order of an update.
MAPPER = {
    "on_motion": "motion to poses",
    "on_scan": "scans taken in",
    "update": "whether the cycle is over",
    "end_cycle": "places of detections, movers and the rest",
    "_place": "where the car was at each scan",
    "_trusted": "gate by range rate; which radars and motion are trusted",
}


class Stopwatch:
    """Remembers how much processor time each stage took, without the stages that it called, and how often it was called.

    `clock` may count something else than seconds of this thread.
    """

    def __init__(self, clock: Clock | None = None) -> None:
        self.clock = clock or time.thread_time
        self.spent: dict[str, float] = {}  # s
        self.calls: dict[str, int] = {}
        self._inside = [0.0]

    def timed(self, stage: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """The same work, counted as a stage's."""

        def run(*arguments: Any, **named: Any) -> Any:
            self._inside.append(0.0)
            begun = self.clock()
            try:
                return work(*arguments, **named)
            finally:
                took = self.clock() - begun
                own = took - self._inside.pop()
                self._inside[-1] += took
                self.spent[stage] = self.spent.get(stage, 0.0) + own
                self.calls[stage] = self.calls.get(stage, 0) + 1

        return run

    def on(self, owner: object, **stages: str) -> None:
        """Methods of an object, by name, as stages'."""
        for name, stage in stages.items():
            setattr(owner, name, self.timed(stage, getattr(owner, name)))

    def clear(self) -> None:
        """From here on."""
        self.spent.clear()
        self.calls.clear()


@dataclass(frozen=True, slots=True)
class Stages:
    """Means of the map updates of a drive, in ms of processor time."""

    model: str  # which one ran, and why
    updates: int
    rate_hz: float  # updates of a second of the drive
    per_update_ms: dict[str, float]  # stage by stage; in all, a whole cycle with its frames and what of publishing falls to it
    windows: int  # that were taken to be published
    inference_ms: float | None  # of one run of the network; None where none runs

    @property
    def cycle_ms(self) -> float:
        """The whole of an update, somebody taking all messages."""
        return sum(self.per_update_ms.values())

    @property
    def unheard_ms(self) -> float:
        """At most, while nobody takes any: then there is a window a second (`topics.announcer`)."""
        publishing = sum(self.per_update_ms.get(stage, 0.0) for stage in PUBLISHING)
        return self.cycle_ms - publishing + publishing * self.updates / max(self.windows, 1) / self.rate_hz


def stages(
    drive: Drive,
    model: str | None,
    seconds: float,
    on_progress: Callable[[float], None] | None = None,
    *,
    clock: Clock | None = None,
) -> Stages:
    """The first seconds of a drive, as the service maps and encodes them; `clock` as in Stopwatch. Raises EchogridError."""
    config = load_config(drive.config, model)
    pipeline, watch = Pipeline(config, drive.config), Stopwatch(clock)
    mapper, infer = pipeline.mapper, pipeline.model.infer
    pieces = pipeline.signals.pieces

    def counted_pieces(*arguments: Any) -> Iterator[Any]:
        step = watch.timed(FRAMES, partial(next, pieces(*arguments), None))
        while (piece := step()) is not None:
            yield piece

    pipeline.signals.pieces = counted_pieces  # type: ignore[assignment, method-assign]
    watch.on(mapper, **MAPPER)
    watch.on(mapper.doppler, add="errors of wheels and mounts, by Doppler")
    watch.on(mapper.again, add="the gyro's bias, by what is seen again")
    watch.on(mapper.history, add="history", surroundings="history")
    watch.on(mapper.map, takes="measured, into the tiles", measure="measured, into the tiles", integrate="answer into the tiles")
    if isinstance(infer, OnnxSensorModel):
        watch.on(infer, draw="planes for the network", _output=INFERENCE, answer="answer as odds")
    else:
        watch.on(mapper, infer="raster and model")
    snapshots, announcer = Snapshots(), Announcer(config, pipeline.model.why)
    take = watch.timed(PUBLISHING[0], snapshots.take)
    encode = watch.timed(PUBLISHING[1], lambda snapshot: list(announcer.map(snapshot)))
    first = last = 0.0
    updates = 0
    for update in pipeline.updates(Log(drive.log).batches()):
        updates, now = updates + 1, (pipeline.signals.newest_ns or 0) * 1e-9
        if (snapshot := take(mapper, update, config.publish)) is not None:
            encode(snapshot)
        if updates == WARM:
            watch.clear()
            first = now
        last = now
        if on_progress is not None:
            on_progress(min((last - first) / seconds, 1.0) if first else 0.0)
        if first and last - first > seconds:
            break
    counted = updates - WARM
    if counted <= 0:
        raise EchogridError(f"{drive.log}: {updates} map updates came of it, expected more than {WARM}, which are not measured")
    runs = watch.calls.get(INFERENCE, 0)
    return Stages(
        model=pipeline.model.why,
        updates=counted,
        rate_hz=counted / max(last - first, 1e-3),
        per_update_ms={stage: spent / counted * 1e3 for stage, spent in sorted(watch.spent.items(), key=lambda item: -item[1])},
        windows=watch.calls.get(PUBLISHING[1], 0),
        inference_ms=watch.spent[INFERENCE] / runs * 1e3 if runs else None,
    )
