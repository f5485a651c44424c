"""What a recording's times look like: whether they go on, how finely, and whether they are times at all or steps between frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from operator import attrgetter

import can
import numpy as np

from echogrid.logs.formats.account import Account
from echogrid.logs.formats.frame import Frame

END_OF_TIME = 2**31  # s, either way of 1970: what ROS's stamps hold
DATED_FROM = 631_152_000  # s: no CAN recording is from before 1990
DISORDER = 0.05  # s: writers of several buses mix frames up by some milliseconds
LOOK = 2000  # frames that are looked at first
LONGEST_STEP = 10.0  # s: of what is taken for steps between frames


_TIMESTAMP = attrgetter("timestamp")


class Times:
    """Remembers the span of all times, steps back, and the finest step."""

    def __init__(self) -> None:
        self.frames = 0
        self.first = self.last = 0.0  # s, the smallest and the greatest
        self.backward = 0  # steps
        self.farthest_back = 0.0  # s, of one frame from the newest before it
        self.finest = float("inf")  # s, of the steps that are none back and not zero
        self._previous = 0.0

    def add(self, messages: Sequence[Frame | can.Message]) -> None:
        """The next frames, in the file's order."""
        if not messages:
            return
        stamps = np.fromiter(map(_TIMESTAMP, messages), np.float64, len(messages))
        first = stamps[0]
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
        self.frames += len(messages)

    @property
    def seconds(self) -> float:
        """From the smallest to the greatest."""
        return self.last - self.first

    def faults(self) -> list[str]:
        """What keeps these times from being those of the frames, one clause each."""
        if self.frames > 1 and self.seconds == 0:
            return [f"its times do not go on: all {self.frames} frames are of {self.first:.6f} s"]
        if self.farthest_back > DISORDER:
            return [f"its times go back {self.backward} times, by up to {self.farthest_back:.3f} s"]
        return []

    def notes(self) -> list[str]:
        """What is worth a word."""
        said = []
        if self.frames and self.last < DATED_FROM:
            said.append("it has no date: its times count from the beginning of 1970")
        if 0 < self.farthest_back <= DISORDER:
            said.append(f"its frames are out of order by up to {self.farthest_back * 1e3:.3f} ms")
        return said


def settled(groups: Iterator[list[Frame]], account: Account) -> Iterator[list[Frame]]:
    """The same frames; where a format's head cannot say what its times are and they look like steps between frames, with these added up.

    Steps are small and go up and down, on each bus alike; times of several clocks would not.
    """
    first: list[list[Frame]] = []
    seen = 0
    for group in groups:
        first.append(group)
        seen += len(group)
        if seen >= LOOK:
            break
    if not _are_steps([message for group in first for message in group]):
        yield from first
        yield from groups
        return
    account.note("its times are steps from frame to frame, they were added up")
    total_ns = 0
    for group in chain(first, groups):
        for message in group:
            total_ns += round(message.timestamp * 1e9)
            message.timestamp = total_ns / 1e9
        yield group


def _are_steps(messages: list[Frame]) -> bool:
    stamps: dict[str | int | None, list[float]] = {}
    for message in messages:
        stamps.setdefault(message.channel, []).append(message.timestamp)
    if sum(map(len, stamps.values())) < 8 or max(message.timestamp for message in messages) > LONGEST_STEP:
        return False
    back = sum(int((np.diff(of_one) < 0).sum()) for of_one in stamps.values())
    return back > 0.1 * len(messages)
