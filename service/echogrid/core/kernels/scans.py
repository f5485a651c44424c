"""The reference's way from identified frames to scans, as far as time goes on and there is room."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from echogrid.core.kernels.assembly import ROW_BYTES, Counted, Kind, Place, Radar, Rule, State, integer
from echogrid.core.kernels.cells import Bytes, Floats, Integers, Mask
from echogrid.core.kernels.frames import Head, evaluate
from echogrid.core.kernels.identify import Sort

COUNTS = int(Sort.COUNTS)
NEVER = -(2**63)  # ns, of the newest frame before there is one
STEP_NS = 1_000_000_000  # a frame that is older or newer than the newest by more was not reordered: it is a stray, or time has stepped


class Event(IntEnum):
    """What `assemble` is told, and tells: the next frame; the newest time before it, ns or NEVER; the span in which that is to be, from
    when until before when; the first frame that is not to be taken; by how much a frame's time may differ from the newest. Then: why it
    ended, how many of the frames taken count, of them are unknown and have no data, how many scans, detections
    and bytes there are, and all `counters` together."""

    AT = 0
    NEWEST = 1
    SPAN_FIRST = 2
    SPAN_END = 3
    UNTIL = 4
    STEP = 5
    WHY = 6
    TAKEN = 7
    UNKNOWN = 8
    REMOTE = 9
    SCANS = 10
    DETECTIONS = 11
    BYTES = 12
    LOST = 13


class Why(IntEnum):
    """Why it ended: at the last frame; behind one after which time is not within the span; before one whose time differs too much; before
    one for whose scan there may be no room; behind one with which a cycle is whole that the caller reads."""

    ALL_TAKEN = 0
    IS_DUE = 1
    IS_STRAY = 2
    IS_FULL = 3
    IS_UNREAD = 4


class Found(IntEnum):
    """Columns of a whole cycle: which frame made it whole, which radar it is, when it began; if it has a header, when that came, and its
    number; where its detections begin and end, how many said nothing and how many there were too many; where the bytes begin and end that
    its checksum is over (-1: there is none), and what that says."""

    PLACE = 0
    RADAR = 1
    OPENED_NS = 2
    HAS_HEADER = 3
    HEADER_NS = 4
    NUMBER = 5
    BEGIN = 6
    END = 7
    INVALID = 8
    TRUNCATED = 9
    SUM_BEGIN = 10
    SUM_END = 11
    SUM_SAID = 12


def assemble(
    received: Integers,
    roles: Integers,
    sorts: Bytes,
    wrong: Mask,
    sizes: Bytes,
    begins: Integers,
    data: Bytes,
    known: Integers,
    rules: Integers,
    fields: Integers,
    states: Integers,
    slots: Integers,
    numbers: Integers,
    rows: Bytes,
    counters: Integers,
    plans: Integers,
    scales: Floats,
    greatest: float,
    event: Integers,
    scans: Integers,
    values: Floats,
    columns: Floats,
    summed: Bytes,
) -> None:
    """Takes frames (N,) as `event` (14,) says: Event, Why.

    A frame was received at ns `received`, is `known[roles]` (-1: nobody's) and of a Sort, and has `sizes` bytes from `begins` on in `data`;
    `wrong`: its own checksum is. `known` (K, 5): radar (-1: not for here), Kind, least bytes, slot (-1: in order of arrival), 1 if it ends
    a cycle. `rules` (R, 15): Rule. `fields` (R, 4 + counts, 5): Place, as in `signals`, all 0 for none. `plans`, `scales`: as `evaluate`.

    Remembered: `states` (R, 12): State; `slots` and `numbers` (R, M) and `rows` (R, M + 3, 64) of the detections so far; the last three
    rows are header, end and age. Of a whole cycle they are in the order of their slots. What is lost is counted in `counters` (R, 5).

    Of whole cycles: `scans` (S, 13): Found; `values` (S, 3): age, ambiguity and blockage, NaN where not said; `columns` (4, D): range,
    azimuth, range rate and RCS of the detections; `summed`: the bytes that a checksum is over.
    """
    room = _Room(scans, values, columns, summed)
    n, newest, first_ns, end_ns, until, step, *_ = event.tolist()
    why, taken, unknown, remote = Why.ALL_TAKEN, 0, 0, 0
    readers, whose = known.tolist(), roles.tolist()
    one = [Radar(*of_one) for of_one in zip(rules, fields, states, slots, numbers, rows, counters, strict=True)]
    while n < until and why == Why.ALL_TAKEN:
        radar, kind, length, slot, last = readers[whose[n]] if whose[n] >= 0 else (-1,) * 5
        if radar >= 0 and not room.has_for(states[radar], rules[radar], plans):
            why = Why.IS_FULL
            break
        if sorts[n] & COUNTS:
            if newest != NEVER and abs(int(received[n]) - newest) > step:
                why = Why.IS_STRAY
                break
            newest = max(newest, int(received[n]))
            taken += 1
            unknown += bool(sorts[n] & Sort.UNKNOWN)
            remote += bool(sorts[n] & Sort.REMOTE)
        if not first_ns <= newest < end_ns:
            why = Why.IS_DUE
        n += 1
        if radar < 0:
            continue
        if sizes[n - 1] < length or wrong[n - 1]:
            counters[radar, Counted.BAD] += 1
            counters[radar, Counted.BAD_CRC] += sizes[n - 1] >= length
            continue
        begin = begins[n - 1]
        if one[radar].take(kind, data[begin : begin + length], int(received[n - 1]), slot, bool(last)):
            room.add(one[radar], plans, scales, greatest, n - 1, radar)
            if rules[radar, Rule.PLAN] < 0 and why == Why.ALL_TAKEN:
                why = Why.IS_UNREAD
    event[Event.AT], event[Event.NEWEST] = n, newest
    event[Event.WHY :] = why, taken, unknown, remote, room.scans_there, room.used, room.bytes, counters.sum()


class _Room:
    """Where whole cycles go."""

    def __init__(self, scans: Integers, values: Floats, columns: Floats, summed: Bytes) -> None:
        self.scans, self.values, self.columns, self.summed = scans, values, columns, summed
        self.scans_there = self.used = self.bytes = 0

    def has_for(self, state: Integers, rule: Integers, plans: Integers) -> bool:
        """Whether there is room for the cycle that the radar's next frame may make whole."""
        frames = (int(state[State.FRAMES]) if state[State.OPEN] else 0) + 1
        each = 0 if rule[Rule.PLAN] < 0 else int(plans[rule[Rule.PLAN] + Head.EACH])
        fits = self.used + frames * each <= self.columns.shape[1] and self.bytes + (frames + 1) * ROW_BYTES <= len(self.summed)
        return fits and self.scans_there < len(self.scans)

    def add(self, radar: Radar, plans: Integers, scales: Floats, greatest: float, at: int, number: int) -> None:
        """A whole cycle."""
        state, rule, row = radar.state, radar.rule, self.scans[self.scans_there]
        row[:] = 0
        row[Found.PLACE], row[Found.RADAR] = at, number
        for to, column in (
            (Found.OPENED_NS, State.OPENED_NS),
            (Found.HAS_HEADER, State.HAS_HEADER),
            (Found.HEADER_NS, State.HEADER_NS),
            (Found.NUMBER, State.NUMBER),
        ):
            row[to] = state[column]
        said = np.full((3, 1), np.nan)
        self._add_sum(radar, row)
        if rule[Rule.PLAN] >= 0:
            if state[State.HAS_HEADER] and rule[Rule.HEADER_PLAN] >= 0:
                evaluate(plans, scales, int(rule[Rule.HEADER_PLAN]), radar.rows[radar.most :][:1], greatest, said)
            if state[State.HAS_AGE] and rule[Rule.AGE_PLAN] >= 0:
                evaluate(plans, scales, int(rule[Rule.AGE_PLAN]), radar.rows[radar.most + 2 :][:1], greatest, said)
            state[State.HAS_AGE] = 0
            self._add_detections(radar, plans, scales, greatest, row)
        self.values[self.scans_there] = said[:, 0]
        self.scans_there += 1

    def _add_sum(self, radar: Radar, row: Integers) -> None:
        state, rule = radar.state, radar.rule
        row[Found.SUM_BEGIN] = row[Found.SUM_END] = -1
        in_end = rule[Rule.SUMMED_IN] == Kind.END
        if rule[Rule.SUMMED_IN] < 0 or not state[State.HAS_HEADER] or (in_end and not state[State.HAS_END]):
            return
        header, end = radar.rows[radar.most], radar.rows[radar.most + 1]
        whole = header[: rule[Rule.HEADER_BYTES]]
        parts = [whole] if in_end else [whole[: rule[Rule.SUM_FROM]], whole[rule[Rule.SUM_AFTER] :]]
        bytes_ = np.concatenate([*parts, radar.rows[: state[State.FRAMES], : rule[Rule.BYTES]].ravel()])
        row[Found.SUM_BEGIN], self.bytes = self.bytes, self.bytes + len(bytes_)
        row[Found.SUM_END] = self.bytes
        self.summed[row[Found.SUM_BEGIN] : self.bytes] = bytes_
        row[Found.SUM_SAID] = integer(end if in_end else header, radar.fields[Place.SUM])

    def _add_detections(self, radar: Radar, plans: Integers, scales: Floats, greatest: float, row: Integers) -> None:
        state, rule = radar.state, radar.rule
        frames, each = int(state[State.FRAMES]), int(plans[rule[Rule.PLAN] + Head.EACH])
        found = np.full((4, frames * each), np.nan)
        if frames:
            evaluate(plans, scales, int(rule[Rule.PLAN]), radar.rows[:frames], greatest, found)
        if state[State.HAS_HEADER] and state[State.COUNT] >= 0:
            found = found[:, : state[State.COUNT]]
        kept, row[Found.INVALID], row[Found.TRUNCATED] = chosen(found, int(rule[Rule.MOST_DETECTIONS]))
        row[Found.BEGIN], self.used = self.used, self.used + kept.shape[1]
        row[Found.END] = self.used
        self.columns[:, row[Found.BEGIN] : self.used] = kept


def chosen(found: Floats, most: int) -> tuple[Floats, int, int]:
    """Of detections (4, N) the sound ones, of which the `most` nearest in their order; how many were not sound, and how many too many."""
    sound = np.isfinite(found[0] + found[1] + found[2]) & (found[0] > 0)  # the reader's values are small numbers, or NaN
    kept = np.flatnonzero(sound)
    invalid, truncated = len(sound) - len(kept), max(len(kept) - most, 0)
    if truncated:
        kept = kept[np.sort(np.argsort(found[0][kept], kind="stable")[:most])]
    return np.ascontiguousarray(found[:, kept]), invalid, truncated  # columns taken by an index lie apart, which loops refuse
