"""What a recording's times look like: whether they go on, how finely, and whether they are times at all or steps between frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from echogrid.can.intake.frames import FrameBatch
from echogrid.logs.formats.account import Account, UntimelyError

END_OF_TIME = 2**31  # s, either way of 1970: what ROS's stamps hold
TOO_LATE = "{:.6f} s since 1970 is after January 2038, beyond what ROS's stamps hold"
DATED_FROM = 631_152_000  # s: no CAN recording is from before 1990
DISORDER = 0.05  # s: writers of several buses mix frames up by some milliseconds
LOOK = 2000  # frames that are looked at first
LONGEST_STEP = 10.0  # s: of what is taken for steps between frames


class Times:
    """Remembers the span of all times, steps back, and the finest step."""

    def __init__(self) -> None:
        self.frames = 0
        self.first = self.last = 0.0  # s, the smallest and the greatest
        self.backward = 0  # steps
        self.farthest_back = 0.0  # s, of one frame from the newest before it
        self.finest = float("inf")  # s, of the steps that are none back and not zero
        self._previous = 0.0

    def add(self, stamps: NDArray[np.float64]) -> None:
        """The next frames' times (N,) in s, in the file's order."""
        if not len(stamps):
            return
        first = float(stamps[0])
        steps = np.diff(stamps, prepend=self._previous if self.frames else first)
        newest = np.maximum.accumulate(np.concatenate(([self.last if self.frames else first], stamps)))
        on = np.diff(newest)
        if (on > 0).any():
            self.finest = min(self.finest, float(on[on > 0].min()))
        if (steps < 0).any():
            self.backward += int((steps < 0).sum())
            self.farthest_back = max(self.farthest_back, float((newest[1:] - stamps).max()))
        self.first = min(self.first if self.frames else first, float(stamps.min()))
        self.last, self._previous = float(newest[-1]), float(stamps[-1])
        self.frames += len(stamps)

    @property
    def seconds(self) -> float:
        """From the smallest to the greatest."""
        return self.last - self.first

    def faults(self) -> list[str]:
        """What keeps these times from being those of the frames, one clause each."""
        if self.frames > 1 and self.seconds == 0:
            return [f"its times do not go on: all {self.frames} frames are of {self.first:.6f} s"]
        if self.farthest_back > DISORDER:
            often = "once, by" if self.backward == 1 else f"{self.backward} times, by up to"
            return [f"its times go back {often} {self.farthest_back:.3f} s"]
        return []

    def notes(self) -> list[str]:
        """What is worth a word."""
        said = []
        if self.frames and self.last < DATED_FROM:
            said.append("it has no date: its times count from the beginning of 1970")
        if 0 < self.farthest_back <= DISORDER:
            said.append(f"its frames are out of order by up to {self.farthest_back * 1e3:.3f} ms")
        return said


def timely(stamp: float) -> float:
    """The same time, in s since 1970. Raises UntimelyError where no frame can be of it."""
    if stamp >= END_OF_TIME:
        raise UntimelyError(TOO_LATE.format(stamp))
    if not stamp >= 0:
        raise ValueError("no time")
    return stamp


def settled(batches: Iterator[FrameBatch], account: Account) -> Iterator[FrameBatch]:
    """The same frames; where a format's head cannot say what its times are and they look like steps between frames, with these added up.

    Steps are small and go up and down, on each bus alike; times of several clocks would not.
    """
    first: list[FrameBatch] = []
    seen = 0
    for batch in batches:
        first.append(batch)
        seen += len(batch)
        if seen >= LOOK:
            break
    if not _are_steps(first):
        yield from first
        yield from batches
        return
    account.note("its times are steps from frame to frame, they were added up")
    total_ns = np.int64(0)
    for batch in chain(first, batches):
        sums = np.cumsum(np.rint(batch.stamps * 1e9).astype(np.int64)) + total_ns
        total_ns = sums[-1] if len(sums) else total_ns
        yield replace(batch, stamps=sums / 1e9)


def _are_steps(batches: list[FrameBatch]) -> bool:
    stamps: dict[str | int | None, list[NDArray[np.float64]]] = {}
    for batch in batches:
        for number in np.unique(batch.channels).tolist():
            stamps.setdefault(batch.channel(number), []).append(batch.stamps[batch.channels == number])
    channels = [np.concatenate(parts) for parts in stamps.values()]
    count = sum(map(len, channels))
    if count < 8 or max(float(of_one.max()) for of_one in channels) > LONGEST_STEP:
        return False
    return sum(int((np.diff(of_one) < 0).sum()) for of_one in channels) > 0.1 * count
