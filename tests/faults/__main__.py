"""`python -m tests.faults`: every fault at several random times, written as a table into docs/reliability.md."""

from __future__ import annotations

import math

import numpy as np

from tests.faults.drive import stretch
from tests.faults.experiment import Outcome, Ride, compare
from tests.faults.faults import FAULTS, Fault
from tests.support.places import DOCS

PAGE = DOCS / "reliability.md"
BEGIN, END = "<!-- faults -->", "<!-- end of faults -->"
FIRST, SECONDS, WARM, CELLS = 10.0, 16.0, 6.0, 64  # of the demo, s; the fault comes between WARM and WARM + 1 and is over after 4 s
SEEDS = range(3)


def main() -> None:
    frames = stretch(FIRST, SECONDS)
    warm = Ride(CELLS).drive(frames, WARM)
    rest = tuple(frame for frame in frames if frame.time >= WARM)
    undisturbed = warm.copy().drive(rest, SECONDS)
    rows = []
    for fault in FAULTS:
        outcomes = []
        for seed in SEEDS:
            random = np.random.default_rng(seed)
            start = WARM + random.uniform(0, 1)
            end = start + (4.0 if fault.lasts is None else fault.lasts)
            disturbed = warm.copy().drive(fault.change(rest, start, end, random), SECONDS)
            outcomes.append(compare(fault, disturbed, undisturbed, rest, start, end))
        rows.append(_row(fault, outcomes))
    head = "| fault | state | reason given | noticed after | recovered after | new maps | pose off by | map error |\n" + "| --- " * 8 + "|"
    text = PAGE.read_text()
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}\n{head}\n" + "\n".join(rows) + f"\n{END}{after}")


def _row(fault: Fault, outcomes: list[Outcome]) -> str:
    """The worst of each."""
    first = outcomes[0]
    state = f"`{first.state}`" if fault.states or fault.new_map else "–"
    new = "/".join(sorted({str(one.new_maps) for one in outcomes}))
    pose, error = max(one.pose_error for one in outcomes), max(one.map_error for one in outcomes)
    known = "–" if math.isnan(error) else f"{error:.1%}"
    reason = first.reason or "–"
    cells = (fault.name, state, reason, _seconds([o.notice for o in outcomes]), _seconds([o.recover for o in outcomes]), new)
    return "| " + " | ".join((*cells, f"{pose:.2f} m", known)) + " |"


def _seconds(values: list[float | None]) -> str:
    known = [value for value in values if value is not None]
    return "–" if not known else f"{max(known):.2f} s" if len(known) == len(values) else f"{len(values) - len(known)} of {len(values)} not"


main()
