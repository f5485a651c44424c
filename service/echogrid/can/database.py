"""What a database of CAN messages says of them, whichever file it came from: where signals lie and when they are there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

FrameId = tuple[int, bool]  # arbitration id, extended
Ranges = tuple[tuple[int, int], ...]  # first and last of each


def overlap(one: Ranges, other: Ranges) -> bool:
    """Whether a number is in both."""
    return any(a <= d and c <= b for a, b in one for c, d in other)


@dataclass(frozen=True, slots=True)
class Signal:
    """One signal as its file describes it; `start` is a DBC's start bit: of a Motorola signal its most significant one.

    `selected_by` and `ids`: the signal is there where that selector has one of those values. Both None: in every frame.
    Several signals of a message may have one name, in branches that exclude each other.
    """

    name: str
    start: int
    length: int
    is_motorola: bool
    is_signed: bool
    scale: float
    offset: float
    is_float: bool = False
    selected_by: str | None = None
    ids: Ranges | None = None
    unit: str = ""  # as the file writes it; no profile relies on it


@dataclass(frozen=True, slots=True)
class Message:
    """`fault`: why the message cannot be used; `unread`: why those of its signals cannot, by name."""

    name: str
    frame_id: int
    is_extended_frame: bool
    length: int  # bytes
    signals: tuple[Signal, ...]
    fault: str | None = None
    unread: Mapping[str, str] = field(default_factory=dict)

    @property
    def id(self) -> FrameId:
        """Of its frames."""
        return self.frame_id, self.is_extended_frame

    def named(self, name: str) -> list[Signal]:
        """The signals of that name: none, one, or one in each of several branches."""
        return [signal for signal in self.signals if signal.name == name]


@dataclass(frozen=True, slots=True)
class Database:
    """All messages of a file, and a sentence for each thing in it that could not be read and is left out."""

    messages: tuple[Message, ...]
    left_out: tuple[str, ...] = ()

    def named(self, name: str) -> list[Message]:
        """The messages of that name, more than one where the file is ambiguous."""
        return [message for message in self.messages if message.name == name]
