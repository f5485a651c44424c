"""`echogrid bench`: what is measured is all there, once, and the same for people and for programs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from contextlib import nullcontext
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from tests.support import world
from tests.support.places import ROOT

from echogrid.commands.measuring import bench
from echogrid.commands.measuring.loops import NAMES, Sample, seen, turned
from echogrid.commands.measuring.stages import FRAMES, MAPPER, PUBLISHING, Stopwatch, stages
from echogrid.core.kernels import dispatch, reference
from echogrid.errors import EchogridError
from echogrid.logs.drive import find_drive

DEMO = ROOT / "service" / "echogrid" / "demo_drive"


@pytest.mark.parametrize(("step", "is_refused"), [(1e-6, False), (0.01, True)])
def test_where_the_clock_counts_ticks_it_is_said(monkeypatch: pytest.MonkeyPatch, step: float, is_refused: bool) -> None:
    """User-Mode Linux's does, by 10 ms: every loop took none, and the ratio of two was a division by zero."""
    looks = count()
    monkeypatch.setattr(time, "thread_time", lambda: next(looks) // 20 * step)
    with pytest.raises(EchogridError, match="in steps of 10 ms") if is_refused else nullcontext():
        bench.check_clock()


def test_what_a_stage_calls_is_not_counted_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that only the work itself moves: each stage has what it did, and together they have all of it."""
    clock = 0.0

    def work(seconds: float) -> None:
        nonlocal clock
        clock += seconds

    monkeypatch.setattr(time, "thread_time", lambda: clock)
    watch = Stopwatch()
    inner = watch.timed("inner", work)

    def both(seconds: float) -> None:
        work(seconds)
        inner(2.0)
        inner(3.0)

    outer = watch.timed("outer", both)
    outer(10.0)
    outer(20.0)
    assert watch.spent == {"inner": 10.0, "outer": 30.0}
    assert watch.calls == {"inner": 4, "outer": 2}
    assert sum(watch.spent.values()) == clock


def test_a_drive_is_mapped_as_ever_and_every_stage_has_its_share() -> None:
    begun = time.thread_time()
    found = stages(find_drive(DEMO, None), "analytic", 2.0)
    assert set(MAPPER.values()) | {FRAMES, "raster and model", "answer into the tiles", "window to publish"} <= {
        *found.per_update_ms,
        "history",
    }
    assert found.updates == pytest.approx(40, abs=2)
    assert found.rate_hz == pytest.approx(20, rel=0.1)
    assert found.inference_ms is None
    assert found.windows == pytest.approx(found.updates / 2, abs=1)
    assert found.cycle_ms - found.unheard_ms == pytest.approx(0.9 * sum(found.per_update_ms[stage] for stage in PUBLISHING), rel=0.1)
    assert 0 < found.cycle_ms * found.updates / 1e3 < time.thread_time() - begun


@pytest.mark.parametrize("seconds", [0.0, 1.0])
def test_a_drive_without_updates_to_measure_has_no_figures(tmp_path: Path, seconds: float) -> None:
    drive = world.write_drive(tmp_path / "short", world.record(world.straight(6.0), [world.standing([(9.0, 3.0)])], seconds))
    with pytest.raises(EchogridError, match=r"can.log: \d+ map updates came of it, expected more than 20, which are not measured"):
        stages(find_drive(drive, None), "analytic", 2.0)


def test_what_the_loops_are_given_is_noted_and_they_are_put_back() -> None:
    before = dict(vars(dispatch.loops))
    calls = seen(find_drive(DEMO, None), ("default", "analytic"), Sample(first=5, some=2, every=4))
    assert {name: work for name, work in vars(dispatch.loops).items() if name in NAMES} == {name: before[name] for name in NAMES}
    assert set(calls) == NAMES - {"usual"}  # the car drives
    assert {len(some) for some in calls.values()} == {2}
    (times,) = turned("placed", calls["placed"], (reference,), 3)
    assert len(times) == 3
    assert min(times) > 0


def test_the_command_says_the_same_in_words_and_as_json() -> None:
    command = [sys.executable, "-W", "error", "-m", "echogrid", "bench", "--seconds", "2", "--model", "analytic", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    figures = json.loads(done.stdout)
    assert figures["cycle_ms"] == pytest.approx(sum(figures["per_update_ms"].values()))
    assert figures["share_of_a_core"] == pytest.approx(figures["cycle_ms"] * figures["rate_hz"] / 1e3)
    assert figures["machine"]["numpy"] == np.__version__
    assert (figures["kernels"], bool(figures["loops"])) == (dispatch.WHY, dispatch.COMPILED)
    assert min(figures["floors"].values()) > 1
    said = "\n".join(bench.report(figures))
    for word in (*figures["per_update_ms"], *figures["loops"], figures["model"].partition(",")[0], dispatch.WHY, "whole cycle"):
        assert word in said


def test_in_words_it_prints_the_report(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Of other figures each time, so by their words; the loops are left out, which take longest."""
    monkeypatch.setattr(bench, "seen", lambda drive, models: {})
    bench.command(None, None, "analytic", 1.0, as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("machine: ")
    assert {"raster and model", "whole cycle"} <= {re.sub(r"  +.*", "", line.strip()) for line in lines}
    assert lines[-1].endswith("of a core, without receiving and sending")
