"""Puts the frames of radars' measurement cycles together: a scan is used whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from echogrid.core.health import SensorHealth
from echogrid.core.kernels.assembly import ROW_BYTES, Counted, Kind, Rule, State
from echogrid.core.kernels.dispatch import loops

FrameKind = Kind
MOST_FRAMES = 512  # of detections in a cycle; what has more is none
NO_FIELD = (0, 1, 0, 0, 0)
Field = tuple[int, int, int, int, int]  # where an integer is, as the decoder's loops have it
Rows = NDArray[np.uint8]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class FrameRole:
    """What the frames of one id are in a cycle: `slot` None in order of arrival, `last` those that end it."""

    kind: FrameKind
    length: int  # bytes that are read
    slot: int | None = None
    last: bool = False


@dataclass(frozen=True, slots=True)
class AssemblyRule:
    """How a sensor's cycles begin and end, and where its frames say which cycle's they are."""

    ends_with_message: bool  # else with the last of the expected frames, which then follow the header
    has_header: bool
    frames: int | None  # detection frames in every cycle; None: as the header says
    cycle_bits: int | None  # detection frames carry only so many low bits of the header's cycle number
    timeout_ns: int
    per_frame: int = 1  # detections
    cycle: Field = NO_FIELD  # the number in headers
    detections_cycle: Field = NO_FIELD
    page: Field = NO_FIELD
    counts: tuple[Field, ...] = ()  # summed: detections of the cycle


class Cycle(NamedTuple):
    """A whole cycle, until the next frame is taken. `announced`: detections as the header says; -1: no word."""

    opened_ns: int
    header_ns: int | None  # None: no header
    number: int  # of the header's cycle
    announced: int
    detections: Rows  # (N, 64) in the order of their slots
    header: Rows  # (1, 64), as the rest
    end: Rows | None
    age: Rows | None


class Assembly:
    """Remembers the open cycles of radars (R), and the numbers of the last complete ones.

    Missing, repeated, late and wrong-cycle frames are counted, and an incomplete cycle is discarded.
    """

    def __init__(self, rules: Sequence[AssemblyRule], healths: Sequence[SensorHealth]) -> None:
        radars, fields = len(rules), 3 + max((len(rule.counts) for rule in rules), default=0)
        self._healths = healths
        self._rules = np.array([_row(rule) for rule in rules], np.int64).reshape(-1, len(Rule))
        self._fields = np.zeros((radars, fields, len(NO_FIELD)), np.int64)
        for row, rule in zip(self._fields, rules, strict=True):
            found = (rule.cycle, rule.detections_cycle, rule.page, *rule.counts)
            row[: len(found)] = found
        self._states = np.zeros((radars, len(State)), np.int64)
        self._slots, self._numbers = np.zeros((2, radars, MOST_FRAMES), np.int64)
        self._rows = np.zeros((radars, MOST_FRAMES + 3, ROW_BYTES), np.uint8)
        self._counters = np.zeros((radars, len(Counted)), np.int64)
        self._event = np.zeros(2, np.int64)

    def take(
        self, received_ns: Integers, roles: Integers, wrong: NDArray[np.bool_], sizes: Rows, begins: Integers, data: Rows, known: Integers
    ) -> Iterator[tuple[int, int, Cycle]]:
        """The cycles that frames (N,) make whole: after which frame, which radar's, and what is in it. Arguments as in `assemble`."""
        event = self._event
        event[0] = 0
        while event[0] < len(roles):
            loops.assemble(
                received_ns,
                roles,
                wrong,
                sizes,
                begins,
                data,
                known,
                self._rules,
                self._fields,
                self._states,
                self._slots,
                self._numbers,
                self._rows,
                self._counters,
                event,
            )
            at, radar = event.tolist()
            if radar < 0:
                return
            yield at - 1, radar, self._cycle(radar)
            event[0] = at

    def counted(self) -> int:
        """Adds to the sensors' health what was counted; how many frames were bad."""
        if not self._counters.any():
            return 0
        for health, row in zip(self._healths, self._counters.tolist(), strict=True):
            health.repeated += row[Counted.REPEATED]
            health.wrong_cycle += row[Counted.WRONG_CYCLE]
            health.incomplete += row[Counted.INCOMPLETE]
            health.bad_crc += row[Counted.BAD_CRC]
        bad = int(self._counters[:, Counted.BAD].sum())
        self._counters[:] = 0
        return bad

    def _cycle(self, radar: int) -> Cycle:
        state, rows = self._states[radar], self._rows[radar]
        _, opened_ns, has_header, number, header_ns, _, has_end, frames, _, _, has_age, count = state.tolist()
        state[State.HAS_AGE] = 0
        return Cycle(
            opened_ns,
            header_ns if has_header else None,
            number,
            count if has_header else -1,
            rows[:frames],
            rows[MOST_FRAMES : MOST_FRAMES + 1],
            rows[MOST_FRAMES + 1 : MOST_FRAMES + 2] if has_end else None,
            rows[MOST_FRAMES + 2 :] if has_age else None,
        )


def known_row(radar: int, role: FrameRole) -> tuple[int, int, int, int, int]:
    """A role as `assemble` has it."""
    return radar, int(role.kind), role.length, -1 if role.slot is None else role.slot, int(role.last)


def _row(rule: AssemblyRule) -> tuple[int, ...]:
    mask = -1 if rule.cycle_bits is None else (1 << rule.cycle_bits) - 1
    always = -1 if rule.frames is None else rule.frames
    return int(rule.ends_with_message), int(rule.has_header), always, mask, rule.timeout_ns, rule.per_frame
