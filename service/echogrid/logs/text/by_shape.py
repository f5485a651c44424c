"""Lines in the file's order: plain ones many at once, by their shape, and all others one by one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from echogrid.logs.formats.frame import Frame
from echogrid.logs.text.shapes import Shape, shapes

FEW, MOST_RUNS = 16, 8  # lines that are not worth to be looked at together; runs of plain lines in one chunk


@dataclass(frozen=True, slots=True)
class Parser:
    """How the lines of a format become frames."""

    plain: Callable[[Shape], Iterator[Frame]]  # of lines of one shape; raises ValueError or IndexError where they are not plain
    other: Callable[[bytes, int], Frame | None]  # of any line and its number; tells the account where there is none
    begins: re.Pattern[bytes]  # as plain lines do
    changes: re.Pattern[bytes] | None = None  # lines after which plain ones may mean another thing
    may_be_plain: Callable[[], bool] = lambda: True  # is asked after lines that may change that
    newest: Callable[[Frame], None] = lambda _: None  # is told the last frame of a run
    marks: bytes = b" "  # what stands in the same places in lines of one shape

    def frames(self, first: int, lines: list[bytes]) -> list[Frame]:
        """Of lines that are numbered from `first` on."""
        frames: list[Frame] = []
        at = runs = 0
        while at < len(lines):
            if not self.begins.match(lines[at]) or runs > MOST_RUNS or len(lines) - at < FEW or not self.may_be_plain():
                frames += self._one(lines[at], first + at)
                at += 1
                continue
            run = lines[at:]
            found, there = self._plain(run)
            odd = np.flatnonzero(~there).tolist()
            end = next((n for n in odd if self.changes is not None and self.changes.match(run[n])), len(run))
            for n in odd:
                if n < end and (one := self._one(run[n], first + at + n)):
                    found[n], there[n] = one[0], True
            made: list[Frame] = found[:end][there[:end]].tolist()
            if made:
                self.newest(made[-1])
            frames += made
            at += end
            runs += 1
        return frames

    def _plain(self, lines: list[bytes]) -> tuple[np.ndarray, np.ndarray]:
        """(lines,) frames, and which of them there are."""
        found, there = np.empty(len(lines), object), np.zeros(len(lines), np.bool_)
        for shape in shapes(lines, self.marks):
            with suppress(ValueError, IndexError, KeyError):
                found[shape.lines] = np.fromiter(self.plain(shape), object, len(shape.lines))
                there[shape.lines] = True
        return found, there

    def _one(self, line: bytes, number: int) -> list[Frame]:
        frame = self.other(line, number)
        return [] if frame is None else [frame]
