"""The reference's way to put the frames of a radar's measurement cycles together."""

from __future__ import annotations

import math
from enum import IntEnum

from echogrid.core.kernels.cells import Bytes, Integers

ROW_BYTES = 64


class Kind(IntEnum):
    """What a radar's frame is; AGE carries the age of the measurement alone."""

    HEADER = 0
    DETECTIONS = 1
    END = 2
    AGE = 3


class Rule(IntEnum):
    """Columns of what is said of a radar: what ends a cycle, if it has a header, its frames (-1: as the header says), which bits of the
    header's number its detections have, ns that it may last, and detections in a frame. Plans, as `evaluate` has them, of the detections'
    range, azimuth, range rate and RCS (-1: the caller reads them), and in header and age message of age, ambiguity and blockage (-1: none);
    the most detections that a scan has; bytes of a detection frame and of the header. The Kind that has the cycle's checksum (-1: none),
    and where in the header it begins and ends, if it has."""

    ENDS_WITH_MESSAGE = 0
    NEEDS_HEADER = 1
    ALWAYS = 2
    MASK = 3
    TIMEOUT_NS = 4
    PER_FRAME = 5
    PLAN = 6
    HEADER_PLAN = 7
    AGE_PLAN = 8
    MOST_DETECTIONS = 9
    BYTES = 10
    HEADER_BYTES = 11
    SUMMED_IN = 12
    SUM_FROM = 13
    SUM_AFTER = 14


class Place(IntEnum):
    """Rows of where a radar's integers are: the cycle's number in headers and in detections, the slot, the checksum, and from COUNT on
    what the header's counts are."""

    CYCLE = 0
    DETECTIONS_CYCLE = 1
    PAGE = 2
    SUM = 3
    COUNT = 4


class State(IntEnum):
    """Columns of what is remembered of a radar's cycle. `COUNT`: detections that its header announces, `EXPECTED`: frames; -1: no word."""

    OPEN = 0
    OPENED_NS = 1
    HAS_HEADER = 2
    NUMBER = 3
    HEADER_NS = 4
    EXPECTED = 5
    HAS_END = 6
    FRAMES = 7
    HAS_LAST = 8
    LAST = 9
    HAS_AGE = 10
    COUNT = 11


class Counted(IntEnum):
    """Columns of counters."""

    REPEATED = 0
    WRONG_CYCLE = 1
    INCOMPLETE = 2
    BAD = 3
    BAD_CRC = 4


class Radar:
    """One radar's rows of all arrays."""

    def __init__(
        self, rule: Integers, fields: Integers, state: Integers, slots: Integers, numbers: Integers, rows: Bytes, counters: Integers
    ) -> None:
        self.rule, self.fields, self.state = rule, fields, state
        self.slots, self.numbers, self.rows, self.counters = slots, numbers, rows, counters
        self.most = len(slots)
        self.has_number = bool(fields[Place.CYCLE, 3])
        self.numbered = self.has_number and bool(fields[Place.DETECTIONS_CYCLE, 3])

    def take(self, kind: int, payload: Bytes, received_ns: int, slot: int, last: bool) -> bool:
        """Whether the frame makes the cycle whole."""
        state, fields = self.state, self.fields
        if kind == Kind.AGE:
            state[State.HAS_AGE] = 1
            self.rows[self.most + 2, : len(payload)] = payload
            return False
        if state[State.OPEN] and abs(received_ns - int(state[State.OPENED_NS])) > self.rule[Rule.TIMEOUT_NS]:  # a clock may be set back
            self._give_up()
        if kind == Kind.HEADER:
            if not self._take_header(payload, received_ns):
                return False
        elif kind == Kind.DETECTIONS:
            number = integer(payload, fields[Place.DETECTIONS_CYCLE]) if fields[Place.DETECTIONS_CYCLE, 3] else -1
            slot = integer(payload, fields[Place.PAGE]) if fields[Place.PAGE, 3] else slot
            if not self._take_detections(payload, received_ns, slot, number):
                return False
        if not self.rule[Rule.ENDS_WITH_MESSAGE]:
            return bool(state[State.OPEN]) and self._is_whole() and self._close()
        if not last:
            return False
        if state[State.OPEN]:
            state[State.HAS_END] = 1
            self.rows[self.most + 1, : len(payload)] = payload
        return self._close()

    def _take_header(self, payload: Bytes, received_ns: int) -> bool:
        state = self.state
        number = integer(payload, self.fields[Place.CYCLE]) if self.has_number else -1
        inside = bool(state[State.OPEN] and state[State.HAS_HEADER])
        before = state[State.NUMBER] if inside else state[State.LAST] if state[State.HAS_LAST] else None
        if self.has_number and before is not None and before == number:
            self.counters[Counted.REPEATED] += 1
            return False
        if state[State.OPEN] and (state[State.HAS_HEADER] or not self.rule[Rule.ENDS_WITH_MESSAGE]):
            self._give_up()
        if not state[State.OPEN]:
            self._begin(received_ns)
        counts = [integer(payload, field) for field in self.fields[Place.COUNT :] if field[3]]
        state[State.HAS_HEADER], state[State.NUMBER], state[State.HEADER_NS] = 1, number, received_ns
        state[State.COUNT] = sum(counts) if counts else -1
        state[State.EXPECTED] = math.ceil(max(sum(counts), 0) / self.rule[Rule.PER_FRAME]) if counts else -1
        self.rows[self.most, : len(payload)] = payload
        return True

    def _take_detections(self, payload: Bytes, received_ns: int, slot: int, number: int) -> bool:
        state = self.state
        if not state[State.OPEN]:
            if not self.rule[Rule.ENDS_WITH_MESSAGE]:  # the header comes first, and none came
                self.counters[Counted.WRONG_CYCLE] += 1
                return False
            self._begin(received_ns)
        if state[State.HAS_HEADER] and not self._belongs(number):
            self.counters[Counted.WRONG_CYCLE] += 1
            return False
        frames = int(state[State.FRAMES])
        slot = frames if slot < 0 else slot
        if (self.slots[:frames] == slot).any():
            self.counters[Counted.REPEATED] += 1
            return False
        if frames == self.most:
            self._give_up()
            return False
        self.slots[frames], self.numbers[frames] = slot, number
        self.rows[frames, : len(payload)] = payload
        state[State.FRAMES] += 1
        return True

    def _belongs(self, number: int) -> bool:
        return not self.numbered or number == int(self.state[State.NUMBER]) & int(self.rule[Rule.MASK])

    def _is_whole(self) -> bool:
        state, always = self.state, self.rule[Rule.ALWAYS]
        if not state[State.HAS_HEADER]:
            return bool(not self.rule[Rule.NEEDS_HEADER] and state[State.FRAMES] == always)
        return bool(state[State.FRAMES] >= max(state[State.EXPECTED], always))  # a header may say more than there ever is

    def _close(self) -> bool:
        state = self.state
        if not state[State.OPEN]:
            return False
        state[State.OPEN] = 0
        frames = range(int(state[State.FRAMES]))
        kept = [n for n in frames if not state[State.HAS_HEADER] or self._belongs(int(self.numbers[n]))]  # some came before their header
        kept.sort(key=lambda n: int(self.slots[n]))
        self.counters[Counted.WRONG_CYCLE] += len(frames) - len(kept)
        for array in (self.slots, self.numbers, self.rows):
            array[: len(kept)] = array[kept]
        state[State.FRAMES] = len(kept)
        if not self._is_whole():
            self.counters[Counted.INCOMPLETE] += 1
            return False
        if state[State.HAS_HEADER]:
            state[State.HAS_LAST], state[State.LAST] = self.has_number, state[State.NUMBER]
        return True

    def _begin(self, received_ns: int) -> None:
        self.state[State.OPEN], self.state[State.OPENED_NS] = 1, received_ns
        for column in (State.HAS_HEADER, State.HAS_END, State.FRAMES):
            self.state[column] = 0

    def _give_up(self) -> None:
        self.state[State.OPEN] = 0
        self.counters[Counted.INCOMPLETE] += 1


def integer(payload: Bytes, place: Integers) -> int:
    """A signal's integer, as `signals` has it."""
    byte, step, shift, length, is_signed = place.tolist()
    data = payload.tobytes().ljust(byte + 9, b"\0")
    word = int.from_bytes(data[byte : byte + 9], "little") if step > 0 else int.from_bytes(data[max(byte - 8, 0) : byte + 1], "big")
    value = word >> shift & ((1 << length) - 1)
    value -= (1 << length) if is_signed and value >> (length - 1) else 0
    return int((value + 2**63) % 2**64 - 2**63)
