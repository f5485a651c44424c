"""What an update may cost, stage by stage and loop by loop: what grows beyond its budget fails by name.

No clock on the wall, and no time that other work on the machine could stretch:

- A stage's budget is a number of calls of Python and C functions, which what is interpreted is made of. It is the same in every run, so a
  growth by GROWTH is seen for certain.
- A compiled loop's budget is its share of its numpy reference's time on the same arguments, by turns in one run, the least of many. Beside
  other work on the same core such a share moves by up to a half (docs/performance.md), so only a growth by LOOP_GROWTH fails: a loop that
  no longer vectorises, or does its work twice.
"""

from __future__ import annotations

import platform
import sys
from types import FrameType
from typing import Any

import pytest

from echogrid.commands.measuring.loops import Calls, Sample, seen, turned
from echogrid.commands.measuring.stages import stages
from echogrid.core.kernels import dispatch, reference
from echogrid.logs.drive import find_drive
from tests.support.places import ROOT

DEMO = ROOT / "service" / "echogrid" / "demo_drive"
GROWTH = 1.15  # of a stage
LOOP_GROWTH = 2.5  # of a loop
TURNS, ROUNDS = 8, 6  # of a loop: a round that is within the budget ends it
# Calls in an update.
CALLS: dict[str, float] = {
    "motion to poses": 216,
    "frames to scans and motion": 162,
    "gate by range rate; which radars and motion are trusted": 113,
    "messages to publish": 66,
    "scans taken in": 100,
    "places of detections, movers and the rest": 92,
    "history": 26,
    "window to publish": 31,
    "the gyro's bias, by what is seen again": 33,
    "measured, into the tiles": 41,
    "whether the cycle is over": 86,
    "where the car was at each scan": 34,
    "errors of wheels and mounts, by Doppler": 26,
    "answer into the tiles": 32,
    "planes for the network": 23,
    "network": 18,
    "answer as odds": 10,
}
# Of numpy's time.
SHARES: dict[str, float] = {
    "add_clamped": 0.176,
    "add_looks": 0.087,
    "add_measured": 0.087,
    "assemble": 0.007,
    "bilinear": 0.164,
    "common_motion": 0.103,
    "deviations": 0.06,
    "differing": 0.46,
    "draw_looks": 0.071,
    "draw_now": 0.049,
    "draw_passes": 0.148,
    "draw_past": 0.206,
    "elfes": 0.06,
    "fold": 0.202,
    "gated": 0.034,
    "gathered": 0.166,
    "leanings": 0.023,
    "look": 0.097,
    "note_views": 0.166,
    "odds": 0.065,
    "percent": 0.165,
    "placed": 0.08,
    "possible": 0.296,
    "read_out": 0.066,
    "recalled": 0.21,
    "sensors": 0.085,
    "standing": 0.035,
}

COMPARED = pytest.mark.skipif(
    not dispatch.COMPILED or platform.machine() != "x86_64",
    reason="loops are compared where they are compiled, by what they take on x86-64",
)


def test_no_stage_makes_more_calls_than_it_may() -> None:
    count = 0

    def noted(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(noted)
    try:
        found = stages(find_drive(DEMO, None), "default", 2.0, clock=lambda: float(count)).per_update_ms
    finally:
        sys.setprofile(None)
    calls = {stage: spent / 1e3 for stage, spent in found.items()}
    assert set(calls) == set(CALLS), calls
    above = {
        stage: f"{calls[stage]:.0f} calls, at most {budget * GROWTH:.0f}"
        for stage, budget in CALLS.items()
        if calls[stage] > budget * GROWTH
    }
    assert not above


@pytest.fixture(scope="module")
def calls() -> Calls:
    return seen(find_drive(DEMO, None), ("default", "analytic"), Sample(first=40, some=4, every=6))


@COMPARED
@pytest.mark.parametrize("name", SHARES)
def test_no_loop_takes_more_of_its_reference_than_it_may(name: str, calls: Calls) -> None:
    shares = []
    for _ in range(ROUNDS):
        fast, slow = turned(name, calls[name], (dispatch.loops, reference), TURNS)
        shares.append(min(fast) / min(slow))
        if shares[-1] <= SHARES[name] * LOOP_GROWTH:
            return
    pytest.fail(f"{name}: {min(shares):.3f} of numpy's time, at most {SHARES[name] * LOOP_GROWTH:.3f}")


@COMPARED
def test_every_loop_of_an_update_has_a_budget(calls: Calls) -> None:
    assert set(SHARES) == set(calls)
