"""Puts the frames of one radar's measurement cycle together: a scan is used whole or not at all."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from echogrid.core.health import SensorHealth


class FrameKind(Enum):
    HEADER = "header"
    DETECTIONS = "detections"
    END = "end"


class CycleFrame(NamedTuple):
    """One CAN frame of a radar, with the few numbers that say where it belongs. A tuple: thousands are made in a second."""

    kind: FrameKind
    payload: bytes
    received_ns: int
    cycle: int | None = None  # the measurement cycle's number as this frame states it
    slot: int | None = None  # place among the cycle's detection frames; None: in order of arrival
    expected: int | None = None  # header only: how many detection frames its cycle has
    last: bool = False  # this frame ends the cycle


@dataclass(slots=True)
class Cycle:
    """The frames of one measurement cycle, `frames` by slot."""

    opened_ns: int
    header: CycleFrame | None = None
    end: CycleFrame | None = None
    frames: dict[int, CycleFrame] = field(default_factory=dict)

    def detection_frames(self) -> list[CycleFrame]:
        """In order of their slots."""
        return [self.frames[slot] for slot in sorted(self.frames)]


@dataclass(frozen=True, slots=True)
class AssemblyRule:
    """How this sensor's cycles begin and end."""

    ends_with_message: bool  # else with the last of the expected frames, which then follow the header
    has_header: bool
    frames: int | None  # detection frames in every cycle; None: as the header says
    cycle_bits: int | None  # detection frames carry only so many low bits of the header's cycle number
    timeout_ns: int


class ScanAssembler:
    """Remembers the open cycle and the number of the last complete one.

    `add` returns a cycle when its last frame has come. Missing, repeated, late and wrong-cycle frames are counted in `health`,
    and an incomplete cycle is discarded.
    """

    def __init__(self, rule: AssemblyRule, health: SensorHealth) -> None:
        self.rule = rule
        self.health = health
        self.open: Cycle | None = None
        self.last_cycle: int | None = None

    def add(self, frame: CycleFrame) -> Cycle | None:
        """The complete cycle that this frame ends, or None."""
        if self.open is not None and abs(frame.received_ns - self.open.opened_ns) > self.rule.timeout_ns:  # abs: a clock may be set back
            self._give_up()
        if frame.kind is FrameKind.HEADER and not self._take_header(frame):
            return None
        if frame.kind is FrameKind.DETECTIONS and not self._take_detections(frame):
            return None
        if self.rule.ends_with_message:
            if not frame.last:
                return None
            if self.open is not None:
                self.open.end = frame
            return self._close()
        return self._close() if self.open is not None and self._is_whole(self.open) else None

    def _take_header(self, frame: CycleFrame) -> bool:
        repeated = frame.cycle is not None and frame.cycle == (
            self.open.header.cycle if self.open is not None and self.open.header is not None else self.last_cycle
        )
        if repeated:
            self.health.repeated += 1
            return False
        if self.open is not None and (self.open.header is not None or not self.rule.ends_with_message):
            self._give_up()
        if self.open is None:
            self.open = Cycle(frame.received_ns)
        self.open.header = frame
        return True

    def _take_detections(self, frame: CycleFrame) -> bool:
        if self.open is None:
            if not self.rule.ends_with_message:  # the header comes first, and none came
                self.health.wrong_cycle += 1
                return False
            self.open = Cycle(frame.received_ns)
        if self.open.header is not None and not self._belongs(frame, self.open.header):
            self.health.wrong_cycle += 1
            return False
        slot = len(self.open.frames) if frame.slot is None else frame.slot
        if slot in self.open.frames:
            self.health.repeated += 1
            return False
        self.open.frames[slot] = frame
        return True

    def _belongs(self, frame: CycleFrame, header: CycleFrame) -> bool:
        if frame.cycle is None or header.cycle is None:
            return True
        mask = -1 if self.rule.cycle_bits is None else (1 << self.rule.cycle_bits) - 1
        return frame.cycle == header.cycle & mask

    def _is_whole(self, cycle: Cycle) -> bool:
        if cycle.header is None:
            return not self.rule.has_header and len(cycle.frames) == self.rule.frames
        expected = cycle.header.expected if self.rule.frames is None else self.rule.frames
        return expected is None or len(cycle.frames) >= expected

    def _close(self) -> Cycle | None:
        cycle, self.open = self.open, None
        if cycle is None:
            return None
        if cycle.header is not None:  # frames that came before their header could not be judged earlier
            kept = {slot: frame for slot, frame in cycle.frames.items() if self._belongs(frame, cycle.header)}
            self.health.wrong_cycle += len(cycle.frames) - len(kept)
            cycle.frames = kept
        if not self._is_whole(cycle):
            self.health.incomplete += 1
            return None
        if cycle.header is not None:
            self.last_cycle = cycle.header.cycle
        return cycle

    def _give_up(self) -> None:
        self.open = None
        self.health.incomplete += 1
