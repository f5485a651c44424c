"""Puts the frames of radars' measurement cycles together: a scan is used whole or not at all."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from echogrid.core.health import SensorHealth
from echogrid.core.kernels.assembly import ROW_BYTES, Counted, Kind, Place, Rule, State
from echogrid.core.kernels.dispatch import loops
from echogrid.core.kernels.frames import GREATEST, Head
from echogrid.core.kernels.plans import Plan, Plans
from echogrid.core.kernels.scans import NEVER, STEP_NS, Event, Found, Why
from echogrid.core.messages import Floats

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
    plan: Plan | None = None  # range, azimuth, range rate and RCS of the detections; None: they are left as they came
    header_plan: Plan | None = None  # as VALUES, in the header
    age_plan: Plan | None = None  # and in the age's message
    most: int = 2**31  # detections of a scan: the nearest are kept
    bytes: int = 0  # of a detection frame
    header_bytes: int = 0
    summed: FrameKind | None = None  # whose frame has the cycle's checksum
    sum: Field = NO_FIELD
    sum_bytes: tuple[int, int] = (0, 0)  # where it begins and ends in the header, if it is there


VALUES = ("age", "ambiguity", "blockage")  # of a cycle, s, m/s, 0 to 1
COLUMNS = ("range", "azimuth", "range_rate", "rcs")
Columns = tuple[Floats, Floats, Floats, Floats]  # (N,) each


class Unread(NamedTuple):
    """What the loops cannot read of a cycle: rows (N, 64), in the order of their slots the detections'."""

    announced: int  # detections as the header says; -1: no word
    detections: Rows
    header: Rows | None  # (1, 64), as the age
    age: Rows | None


class Cycle(msgspec.Struct, frozen=True, eq=False):
    """A whole cycle of a radar."""

    place: int  # of the frame that made it whole
    radar: int
    opened_ns: int
    header_ns: int | None  # None: no header
    number: int  # of the header's cycle
    values: list[float]  # VALUES, NaN where not said
    columns: Columns  # of the detections that say something
    invalid: int  # detections that say nothing
    truncated: int  # and those that are too many
    summed: bytes | None  # what the cycle's checksum is over; None where there is none
    said: int  # by the checksum
    unread: Unread | None  # else `values` and `columns` are none yet


class Frames(NamedTuple):
    """Frames (N,), as `assemble` has them."""

    received_ns: Integers
    roles: Integers
    sorts: Rows
    wrong: NDArray[np.bool_]
    sizes: Rows
    begins: Integers
    data: Rows


class Taken(msgspec.Struct, frozen=True, eq=False):
    """Frames that were taken: behind the last, and how many of them count, are unknown, or have no data."""

    end: int
    newest_ns: int  # NEVER before the first
    is_stray: bool  # the next one's time is too far off
    frames: int
    unknown: int
    remote: int
    lost: bool  # whether something was, which `counted` says
    cycles: list[Cycle]


Span = tuple[int, int]  # ns: the first, and the first behind it
ALWAYS: Span = (NEVER, 2**63 - 1)
SCANS, DETECTIONS = 64, 4096  # that there is room for, beside those of one radar
_ASKED = struct.Struct(f"={int(Event.WHY)}q")  # the begin of an event
_MORE, _STRAY = (int(Why.IS_FULL), int(Why.IS_UNREAD)), int(Why.IS_STRAY)


class Assembly:
    """Remembers the open cycles of radars (R), and the numbers of the last complete ones.

    Missing, repeated, late and wrong-cycle frames are counted, and an incomplete cycle is discarded.
    """

    def __init__(self, rules: Sequence[AssemblyRule], healths: Sequence[SensorHealth], known: Integers) -> None:
        """`known` (K, 5): rows as of `known_row`."""
        radars, fields, plans = len(rules), len(Place) + max((len(rule.counts) for rule in rules), default=0), Plans()
        self._healths = healths
        self._rules = np.array([_row(rule, plans) for rule in rules], np.int64).reshape(-1, len(Rule))
        self._fields = np.zeros((radars, fields, len(NO_FIELD)), np.int64)
        self._fields[:] = NO_FIELD
        for row, rule in zip(self._fields, rules, strict=True):
            found = (rule.cycle, rule.detections_cycle, rule.page, rule.sum, *rule.counts)
            row[: len(found)] = found
        self._is_unread = [rule.plan is None for rule in rules]
        self._states = np.zeros((radars, len(State)), np.int64)
        self._slots, self._numbers = np.zeros((2, radars, MOST_FRAMES), np.int64)
        self._rows = np.zeros((radars, MOST_FRAMES + 3, ROW_BYTES), np.uint8)
        self._counters = np.zeros((radars, len(Counted)), np.int64)
        self._event = np.zeros(len(Event), np.int64)
        each = max((rule.plan.numbers[Head.EACH] for rule in rules if rule.plan is not None), default=1)
        self._scans, self._values = np.empty((SCANS, len(Found)), np.int64), np.empty((SCANS, len(VALUES)))
        self._columns = np.empty((len(COLUMNS), (MOST_FRAMES + 1) * each + DETECTIONS))
        self._summed = np.empty((2 * MOST_FRAMES + 2) * ROW_BYTES, np.uint8)
        self._arguments: tuple[Any, ...] = (
            *(known, self._rules, self._fields, self._states, self._slots, self._numbers, self._rows, self._counters, *plans.arrays()),
            *(GREATEST, self._event, self._scans, self._values, self._columns, self._summed),
        )

    def take(self, frames: Frames, begin: int, until: int, newest_ns: int, span: Span) -> Taken:
        """Takes frames from `begin` on and before `until`, as long as the time of the newest, which `newest_ns` was before, is in the span;
        one whose time is off by more than STEP_NS is left."""
        cycles = list[Cycle]()
        _ASKED.pack_into(self._event.data, 0, begin, newest_ns, *span, until, STEP_NS)
        taken = unknown = remote = 0
        while True:
            loops.assemble(*frames, *self._arguments)
            end, newest_ns, _, _, _, _, why, some, without_reader, without_data, scans, detections, summed, lost = self._event.tolist()
            taken, unknown, remote = taken + some, unknown + without_reader, remote + without_data
            if scans:
                self._read(scans, detections, summed, cycles)
            if why not in _MORE:
                return Taken(end, newest_ns, why == _STRAY, taken, unknown, remote, lost > 0, cycles)

    def counted(self) -> int:
        """Adds to the sensors' health what was counted; how many frames were bad."""
        for health, row in zip(self._healths, self._counters.tolist(), strict=True):
            health.repeated += row[Counted.REPEATED]
            health.wrong_cycle += row[Counted.WRONG_CYCLE]
            health.incomplete += row[Counted.INCOMPLETE]
            health.bad_crc += row[Counted.BAD_CRC]
        bad = int(self._counters[:, Counted.BAD].sum())
        self._counters[:] = 0
        return bad

    def _read(self, scans: int, detections: int, summed_bytes: int, cycles: list[Cycle]) -> None:
        ranges, azimuths, rates, rcs = self._columns[:, :detections].copy()
        summed = self._summed[:summed_bytes].tobytes()
        for row, values in zip(self._scans[:scans].tolist(), self._values[:scans].tolist(), strict=True):
            place, radar, opened_ns, has_header, header_ns, number, begin, end, invalid, truncated, sum_begin, sum_end, said = row
            cycles.append(
                Cycle(
                    place,
                    radar,
                    opened_ns,
                    header_ns if has_header else None,
                    number,
                    values,
                    (ranges[begin:end], azimuths[begin:end], rates[begin:end], rcs[begin:end]),
                    invalid,
                    truncated,
                    summed[sum_begin:sum_end] if sum_begin >= 0 else None,
                    said,
                    self._unread(radar) if self._is_unread[radar] else None,
                )
            )

    def _unread(self, radar: int) -> Unread:
        """Of the cycle that the loops took last."""
        state, rows = self._states[radar], self._rows[radar]
        has_header, has_age = state[State.HAS_HEADER], state[State.HAS_AGE]
        state[State.HAS_AGE] = 0
        return Unread(
            int(state[State.COUNT]) if has_header else -1,
            rows[: state[State.FRAMES]].copy(),
            rows[MOST_FRAMES : MOST_FRAMES + 1].copy() if has_header else None,
            rows[MOST_FRAMES + 2 :].copy() if has_age else None,
        )


def known_row(radar: int, role: FrameRole) -> tuple[int, int, int, int, int]:
    """A role as `assemble` has it."""
    return radar, int(role.kind), role.length, -1 if role.slot is None else role.slot, int(role.last)


def _row(rule: AssemblyRule, plans: Plans) -> tuple[int, ...]:
    mask = -1 if rule.cycle_bits is None else (1 << rule.cycle_bits) - 1
    always = -1 if rule.frames is None else rule.frames
    begins = plans.add(rule.plan), plans.add(rule.header_plan), plans.add(rule.age_plan)
    sums = -1 if rule.summed is None else int(rule.summed), *rule.sum_bytes
    ends, has_header = int(rule.ends_with_message), int(rule.has_header)
    return ends, has_header, always, mask, rule.timeout_ns, rule.per_frame, *begins, rule.most, rule.bytes, rule.header_bytes, *sums
