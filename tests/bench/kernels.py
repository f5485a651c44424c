"""The compiled loops beside their numpy reference, on what the demo drive gives them, by turns in one run.

`python -m tests.bench.kernels` prints them.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from echogrid.can.signals import bus_of
from echogrid.config.loading import load_config
from echogrid.core.kernels import compiled, dispatch, reference
from echogrid.logs.drive import find_drive
from echogrid.logs.log import Log
from echogrid.pipeline import Pipeline

DEMO = Path(__file__).parents[2] / "service" / "echogrid" / "demo_drive"
FIRST, SOME, EVERY = 200, 12, 25  # calls of each loop: so many are left out, so many looked at, of so many
TURNS = 15
MODELS = ("default", "analytic")


def kernels() -> dict[str, tuple[float, float]]:
    """Microseconds of one call, compiled and in numpy: medians of the turns."""
    found = {}
    for name, calls in seen().items():
        times: tuple[list[float], list[float]] = [], []
        for _ in range(TURNS):
            for loops, spent in zip((compiled, reference), times, strict=True):
                total = 0.0
                for arguments in calls:
                    own = [value.copy() if isinstance(value, np.ndarray) else value for value in arguments]
                    begun = time.thread_time()
                    getattr(loops, name)(*own)
                    total += time.thread_time() - begun
                spent.append(total / len(calls) * 1e6)
        found[name] = statistics.median(times[0]), statistics.median(times[1])
    return found


def seen() -> dict[str, list[list[Any]]]:
    """The arguments of some calls of each loop."""
    calls: dict[str, list[list[Any]]] = {}
    counts: dict[str, int] = {}

    def noting(name: str) -> Any:
        work = getattr(compiled, name)

        def run(*arguments: Any) -> None:
            counts[name] = counts.get(name, 0) + 1
            if counts[name] > FIRST and counts[name] % EVERY == 0 and len(calls.get(name, ())) < SOME:
                calls.setdefault(name, []).append([value.copy() if isinstance(value, np.ndarray) else value for value in arguments])
            work(*arguments)

        return run

    names = [name for name in dir(compiled) if not name.startswith("_")]
    with mock.patch.multiple(dispatch.loops, **{name: noting(name) for name in names}):
        for model in MODELS:
            drive = find_drive(DEMO, None)
            config = load_config(drive.config, model)
            pipeline = Pipeline(config, drive.config)
            for message in Log(drive.log):
                pipeline.add(bus_of(message, config.bus) or "", message)
                if pipeline.health.cycles > FIRST + 2 * SOME * EVERY:
                    break
    return calls


if __name__ == "__main__":
    for name, (fast, slow) in kernels().items():
        print(f"{name:<16}{fast:9.1f} us{slow:9.1f} us in numpy{fast / slow:8.3f} x")
