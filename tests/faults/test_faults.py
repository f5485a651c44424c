"""Every fault at a random time: it is named in time, goes by itself, and leaves neither a wrong pose nor a wrong map behind."""

from __future__ import annotations

import numpy as np
import pytest

from tests.faults.drive import Frame, stretch
from tests.faults.experiment import LOOK, Ride, compare
from tests.faults.faults import FAULTS, Fault

WARM, LASTS, SECONDS = 5.5, 3.0, 11.5
CELLS = 32  # of 0.94 m: quick; the table in docs/reliability.md is made on the real grid
MAP_ERROR = 0.12  # share of cells


@pytest.fixture(scope="module")
def warm() -> tuple[Ride, tuple[Frame, ...], Ride]:
    """A ride up to where the faults begin, the frames after that, and the ride that had none."""
    frames = stretch(14.5, SECONDS)
    begun = Ride(CELLS).drive(frames, WARM)
    rest = tuple(frame for frame in frames if frame.time >= WARM)
    return begun, rest, begun.copy().drive(rest, SECONDS)


def test_without_a_fault_nothing_is_noticed(warm: tuple[Ride, tuple[Frame, ...], Ride]) -> None:
    _, _, undisturbed = warm
    assert {look.state.name for look in undisturbed.looks if look.time > 0.3} == {"ok"}
    assert undisturbed.pipeline.mapper.epoch == 0


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault(fault: Fault, warm: tuple[Ride, tuple[Frame, ...], Ride]) -> None:
    begun, rest, undisturbed = warm
    random = np.random.default_rng([7, *fault.name.encode()])
    start = WARM + random.uniform(0.0, 0.4)
    end = start + (LASTS if fault.lasts is None else fault.lasts)
    until = min(SECONDS, end + fault.recover + 0.3)
    outcome = compare(fault, begun.copy().drive(fault.change(rest, start, end, random), SECONDS), undisturbed, rest, start, end)
    if fault.states or fault.new_map:
        assert outcome.notice is not None, outcome
        assert outcome.notice <= fault.notice + LOOK, outcome
    else:
        assert outcome.state == "ok", outcome
    assert until <= SECONDS
    assert outcome.recover is not None, outcome
    assert outcome.recover <= fault.recover + LOOK, outcome
    assert (outcome.new_maps > 0) == fault.new_map, outcome
    assert outcome.pose_error <= fault.pose, outcome
    assert outcome.map_error <= MAP_ERROR, outcome
