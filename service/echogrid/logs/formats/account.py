"""What became of every line, object and byte of a recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from echogrid.can.intake.frames import Frame

MOST_SHOWN = 60  # characters of a line that was not understood


class UntimelyError(ValueError):
    """A frame is of a time that it cannot be of."""


@dataclass(slots=True)
class Account:
    """Remembers what a reader found beside data frames. `faults` are errors of the file; `notes` are worth a word."""

    remote: int = 0  # frames, which are given on
    errors: int = 0  # error frames, which are given on
    others: Counter[str] = field(default_factory=Counter)  # lines or objects that are no frames of CAN or CAN FD, by kind
    odd: int = 0  # lines or stretches of bytes that were not understood
    first_odd: str = ""  # where the first of them is, and its beginning
    torn: str = ""  # how the file ends before its end
    notes: list[str] = field(default_factory=list)

    def kind(self, frame: Frame | None) -> Frame | None:
        """The same frame, counted where it is no data frame."""
        if frame is not None:
            self.remote += frame.is_remote_frame
            self.errors += frame.is_error_frame
        return frame

    def line(self, number: int, text: bytes, error: Exception | None = None) -> None:
        """A line that was not understood; lines count from 1. `error`: why, which is told where its time alone is to blame."""
        self.lost(f"line {number}: '{_shown(text)}'" + (f", where {error}" if isinstance(error, UntimelyError) else ""))

    def lost(self, what: str) -> None:
        """Anything that was not understood; `what` says where it is."""
        self.first_odd = self.first_odd or what
        self.odd += 1

    def tear(self, how: str) -> None:
        """The first way in which the file turned out to be torn is the one that is told."""
        self.torn = self.torn or how

    def note(self, what: str) -> None:
        """Once for each."""
        if what not in self.notes:
            self.notes.append(what)

    def faults(self, frames: int) -> list[str]:
        """What was lost, one clause each; `frames`: how many were read."""
        said = []
        if self.odd:
            said.append(f"{self.odd} of its parts could not be understood, the first is {self.first_odd}")
        if self.torn:
            said.append(f"cannot be read beyond message {frames}: {self.torn}")
        return said

    def summary(self) -> str:
        """What was no data frame, in words; empty where there was nothing else."""
        counts = {"error frames": self.errors, "remote frames": self.remote, **dict(self.others.most_common())}
        return ", ".join(f"{kind} {count}" for kind, count in counts.items() if count)


def _shown(text: bytes) -> str:
    shown = text[:MOST_SHOWN].decode("ascii", "backslashreplace").strip()
    shown = "".join(letter if letter.isprintable() else f"\\x{ord(letter):02x}" for letter in shown)
    return shown + (" …" if len(text) > MOST_SHOWN else "")
