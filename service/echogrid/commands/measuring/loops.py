"""The compiled loops beside their numpy reference, on what a drive gives them, by turns in one run."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from echogrid.config.loading import load_config
from echogrid.core.kernels import dispatch, reference
from echogrid.logs.drive import Drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline
from echogrid.topics.announcer import Announcer, Snapshots

TURNS = 15
MODELS = ("default", "analytic")

Calls = dict[str, list[list[Any]]]


class Sample(NamedTuple):
    """Of the calls of each loop: so many are left out at first, then so many are kept, each the last of so many."""

    first: int = 200
    some: int = 12
    every: int = 25

    @property
    def updates(self) -> int:
        """In which there are enough calls, also of a loop that is called at every second update."""
        return 2 * (self.first + self.some * self.every)


SAMPLE = Sample()


class Pace(NamedTuple):
    """Microseconds of one call, medians of the turns; `ratio`: of the turns' least."""

    compiled_us: float
    numpy_us: float
    ratio: float


def paces(calls: Calls) -> dict[str, Pace]:
    """Of each loop; none where numpy runs alone."""
    if not dispatch.COMPILED:
        return {}
    found = {}
    for name, some in calls.items():
        times = turned(name, some, (dispatch.loops, reference), TURNS)
        fast, slow = (statistics.median(spent) * 1e6 for spent in times)
        found[name] = Pace(fast, slow, min(times[0]) / min(times[1]))
    return found


def turned(name: str, calls: Sequence[Sequence[Any]], modules: Sequence[ModuleType], turns: int) -> list[list[float]]:
    """Processor time of a call (s) in each turn, with each of the modules. What a loop writes is its own."""
    times: list[list[float]] = [[] for _ in modules]
    for _ in range(turns):
        for loops, spent in zip(modules, times, strict=True):
            total = 0.0
            for arguments in calls:
                own = copied(arguments)
                begun = time.thread_time()
                getattr(loops, name)(*own)
                total += time.thread_time() - begun
            spent.append(total / len(calls))
    return times


def copied(arguments: Sequence[Any]) -> list[Any]:
    """With arrays of their own, also in lists."""
    return [copied(each) if isinstance(each, list) else each.copy() if isinstance(each, np.ndarray) else each for each in arguments]


def seen(drive: Drive, models: Sequence[str] = MODELS, sample: Sample = SAMPLE) -> Calls:
    """The arguments of some calls of each loop, in mapping a drive's begin with these models and in publishing the map."""
    calls: Calls = {}
    with noted(calls, sample):
        for model in models:
            config = load_config(drive.config, model)
            pipeline, snapshots, announcer = Pipeline(config, drive.config), Snapshots(), Announcer(config, "")
            for update in pipeline.updates(Log(drive.log).batches()):
                if (snapshot := snapshots.take(pipeline.mapper, update, config.publish)) is not None:
                    list(announcer.map(snapshot))
                if pipeline.health.cycles > sample.updates:
                    break
    return calls


@contextmanager
def noted(calls: Calls, sample: Sample) -> Iterator[None]:
    """Meanwhile the loops note what they are given."""
    counts: dict[str, int] = {}
    loops: Any = dispatch.loops
    works = {name: work for name, work in vars(loops).items() if callable(work) and name in NAMES}

    def noting(name: str, work: Callable[..., None]) -> Callable[..., None]:
        def run(*arguments: Any) -> None:
            counts[name] = counts.get(name, 0) + 1
            if counts[name] > sample.first and counts[name] % sample.every == 0 and len(calls.get(name, ())) < sample.some:
                calls.setdefault(name, []).append(copied(arguments))
            work(*arguments)

        return run

    for name, work in works.items():
        setattr(loops, name, noting(name, work))
    try:
        yield
    finally:
        for name, work in works.items():
            setattr(loops, name, work)


# Of the update, not the readers' of recordings, nor `identify` and `nearby`, which are called once a batch and every three seconds.
NAMES = frozenset(
    (
        *("deviations", "draw_now", "draw_past", "draw_passes", "draw_looks"),
        *("bilinear", "add_clamped", "note_views", "add_looks", "elfes", "look", "add_measured", "usual"),
        *("assemble", "fold", "odds", "standing", "common_motion", "read_out", "percent", "differing"),
        *("gathered", "sensors", "placed", "recalled", "gated", "possible", "leanings"),
    )
)
