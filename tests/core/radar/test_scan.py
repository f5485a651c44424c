"""Scan assembly: every way in which frames go missing, come twice, late, or from another cycle."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from echogrid.core.health import SensorHealth
from echogrid.core.kernels.scans import NEVER
from echogrid.core.radar.scan import ALWAYS, NO_FIELD, Assembly, AssemblyRule, FrameKind, FrameRole, Frames, known_row

MS = 1_000_000
BYTE = [(place, 1, 0, 8, 0) for place in range(3)]  # cycle, slot, and in a header the count of detections
COUNTED = AssemblyRule(
    ends_with_message=False,
    has_header=True,
    frames=None,
    cycle_bits=None,
    timeout_ns=40 * MS,
    cycle=BYTE[0],
    detections_cycle=BYTE[0],
    page=BYTE[1],
    counts=(BYTE[2],),
)
CLOSED = replace(COUNTED, ends_with_message=True, cycle_bits=2)
ROLES = [FrameRole(FrameKind.HEADER, 3), FrameRole(FrameKind.DETECTIONS, 2), FrameRole(FrameKind.END, 1, last=True)]
ROLES += [FrameRole(FrameKind.DETECTIONS, 2, last=True)]
KNOWN = np.array([known_row(0, role) for role in ROLES])
Sent = tuple[int, bytes, int]  # role, payload, ns


class Done(NamedTuple):
    """A whole cycle: its header's number, those of its detection frames, and their slots."""

    number: int
    cycles: list[int]
    slots: list[int]


class Assembled:
    """One radar, fed frame by frame."""

    def __init__(self, rule: AssemblyRule, health: SensorHealth) -> None:
        self.health = health
        self.assembly = Assembly([rule], [health], KNOWN)

    def add(self, sent: Sent) -> Done | None:
        role, payload, received_ns = sent
        sort, places = np.zeros(1, np.uint8), np.zeros(1, np.int64)
        columns = np.array([received_ns]), np.array([role]), sort, np.zeros(1, np.bool_), np.array([len(payload)], np.uint8), places
        taken = self.assembly.take(Frames(*columns, np.frombuffer(payload, np.uint8)), 0, 1, NEVER, ALWAYS)
        rows = [(cycle.number, cycle.unread.detections) for cycle in taken.cycles if cycle.unread is not None]
        found = [Done(number, detections[:, 0].tolist(), detections[:, 1].tolist()) for number, detections in rows]
        self.assembly.counted()
        return found[0] if found else None


def header(cycle: int, expected: int, at: int = 0) -> Sent:
    return 0, bytes((cycle, 0, expected)), at * MS


def page(cycle: int, slot: int, at: int = 1) -> Sent:
    return 1, bytes((cycle, slot)), at * MS


def end(at: int = 9) -> Sent:
    return 2, b"e", at * MS


def feed(assembled: Assembled, frames: list[Sent]) -> list[Done]:
    return [cycle for frame in frames if (cycle := assembled.add(frame)) is not None]


def test_a_cycle_is_whole_with_its_last_page_in_any_order() -> None:
    for order in itertools.permutations(range(3)):
        health = SensorHealth()
        done = feed(Assembled(COUNTED, health), [header(7, 3), *(page(7, slot) for slot in order)])
        assert done[0].slots == [0, 1, 2]
        assert health == SensorHealth()


def test_a_cycle_without_detections_is_whole_with_its_header() -> None:
    assert len(feed(Assembled(COUNTED, SensorHealth()), [header(1, 0), header(2, 0)])) == 2


def test_a_missing_page_gives_the_scan_up_when_the_next_begins() -> None:
    health = SensorHealth()
    done = feed(Assembled(COUNTED, health), [header(1, 2), page(1, 0), header(2, 1), page(2, 0)])
    assert [cycle.number for cycle in done] == [2]
    assert health == SensorHealth(incomplete=1)


def test_a_page_of_another_cycle_is_no_part_of_this_one() -> None:
    health = SensorHealth()
    assert feed(Assembled(COUNTED, health), [header(2, 2), page(1, 0), page(2, 1)]) == []
    assert health == SensorHealth(wrong_cycle=1)


def test_where_either_states_no_cycle_pages_belong_to_the_open_one() -> None:
    """There is nothing to tell them apart by."""
    for of_header, of_page in ((BYTE[0], NO_FIELD), (NO_FIELD, BYTE[0]), (NO_FIELD, NO_FIELD)):
        for rule, frames in ((COUNTED, []), (CLOSED, [end()])):
            health = SensorHealth()
            silent = replace(rule, cycle=of_header, detections_cycle=of_page)
            assert feed(Assembled(silent, health), [header(7, 2), page(9, 0), page(8, 1), *frames])[0].slots == [0, 1]
            assert health == SensorHealth()


def test_a_page_without_a_header_is_counted() -> None:
    health = SensorHealth()
    assert feed(Assembled(COUNTED, health), [page(1, 0), page(1, 1)]) == []
    assert health == SensorHealth(wrong_cycle=2)


def test_repeated_pages_and_headers_do_not_make_a_scan_whole() -> None:
    health = SensorHealth()
    assembler = Assembled(COUNTED, health)
    assert feed(assembler, [header(1, 2), page(1, 0), page(1, 0), header(1, 2)]) == []
    assert health == SensorHealth(repeated=2)
    assert len(feed(assembler, [page(1, 1)])) == 1


def test_a_frozen_radar_that_repeats_its_last_cycle_makes_no_scan() -> None:
    health = SensorHealth()
    once = [header(5, 1), page(5, 0)]
    assert len(feed(Assembled(COUNTED, health), once * 4)) == 1
    assert health.repeated == 3
    assert health.wrong_cycle == 3


def test_a_cycle_that_takes_too_long_is_given_up() -> None:
    health = SensorHealth()
    done = feed(Assembled(COUNTED, health), [header(1, 2, at=0), page(1, 0, at=1), page(1, 1, at=41)])
    assert done == []
    assert health == SensorHealth(incomplete=1, wrong_cycle=1)


def test_where_the_header_comes_last_pages_of_an_older_cycle_are_sorted_out_at_the_end() -> None:
    """Cycle 6 is 2 in its low two bits; the page that says 1 is left over from cycle 5."""
    health = SensorHealth()
    frames = [page(1, 0), page(2, 1), page(2, 2), header(6, 2), end()]
    done = feed(Assembled(CLOSED, health), frames)
    assert done[0].slots == [1, 2]
    assert health == SensorHealth(wrong_cycle=1)


def test_without_its_header_a_closed_cycle_is_incomplete() -> None:
    health = SensorHealth()
    assert feed(Assembled(CLOSED, health), [page(1, 0), end()]) == []
    assert health == SensorHealth(incomplete=1)


def test_without_any_header_all_slots_make_it_whole() -> None:
    rule = replace(CLOSED, has_header=False, frames=2, cycle_bits=None)
    last = (3, bytes((0, 1)), 2 * MS)
    health = SensorHealth()
    assembler = Assembled(rule, health)
    assert len(feed(assembler, [page(0, 0), last])) == 1
    assert feed(assembler, [last]) == []
    assert health == SensorHealth(incomplete=1)


def test_of_two_radars_each_has_its_own_cycle() -> None:
    """Frames in one batch, taken by turns."""
    healths = [SensorHealth(), SensorHealth()]
    assembly = Assembly([COUNTED, CLOSED], healths, np.array([known_row(radar, role) for radar in range(2) for role in ROLES]))
    sent = [(0, header(1, 2)), (4, page(6 % 4, 5)), (1, page(1, 1)), (4 + 0, header(6, 1)), (1, page(1, 0)), (4 + 2, end())]
    sent[1], sent[3] = (5, page(6 % 4, 5)), (4, header(6, 1))
    data = np.frombuffer(b"".join(frame[1].ljust(8) for _, frame in sent), np.uint8)
    count = len(sent)
    roles, sorts, begins = np.array([role for role, _ in sent]), np.zeros(count, np.uint8), np.arange(count) * 8
    frames = Frames(np.full(count, 5 * MS), roles, sorts, np.zeros(count, np.bool_), np.full(count, 3, np.uint8), begins, data)
    cycles = assembly.take(frames, 0, count, NEVER, ALWAYS).cycles
    read = [(cycle, cycle.unread) for cycle in cycles if cycle.unread is not None]
    found = [(cycle.place, cycle.radar, cycle.number, unread.detections[:, 1].tolist()) for cycle, unread in read]
    assert found == [(4, 0, 1, [0, 1]), (5, 1, 6, [5])]
    assert (assembly.counted(), healths) == (0, [SensorHealth(), SensorHealth()])


def together(sent: list[Sent], known: list[FrameRole], wrong: tuple[int, ...] = ()) -> tuple[Assembly, Frames, SensorHealth]:
    """One radar of COUNTED, and frames that all count, in one batch."""
    health, count = SensorHealth(), len(sent)
    data = np.frombuffer(b"".join(payload.ljust(8) for _, payload, _ in sent), np.uint8)
    sizes, is_wrong = np.array([len(payload) for _, payload, _ in sent], np.uint8), np.isin(np.arange(count), wrong)
    roles, times = np.array([role for role, _, _ in sent]), np.array([at for _, _, at in sent])
    assembly = Assembly([COUNTED], [health], np.array([known_row(0, role) for role in known]))
    return assembly, Frames(times, roles, np.ones(count, np.uint8), is_wrong, sizes, np.arange(count) * 8, data), health


def test_short_frames_and_those_with_a_wrong_checksum_are_bad() -> None:
    short = (1, b"1", 2 * MS)
    assembly, frames, health = together([header(1, 1), page(1, 0), short, page(1, 0), header(2, 0)], ROLES, wrong=(1, 3))
    taken = assembly.take(frames, 0, 5, NEVER, ALWAYS)
    assert [cycle.number for cycle in taken.cycles] == [2]
    assert taken.lost
    assert assembly.counted() == 3
    assert health == SensorHealth(incomplete=1, bad_crc=2)
    assert assembly.counted() == 0


def test_a_frame_whose_time_is_more_than_a_second_off_is_left() -> None:
    assembly, frames, _ = together([header(1, 0), header(2, 0, at=1000), header(3, 0, at=2001)], ROLES)
    taken = assembly.take(frames, 0, 3, NEVER, ALWAYS)
    assert (taken.end, taken.is_stray, taken.newest_ns) == (2, True, 1000 * MS)
    assembly, frames, _ = together([header(1, 0), header(2, 0, at=1000), header(3, 0, at=2000)], ROLES)
    taken = assembly.take(frames, 0, 3, NEVER, ALWAYS)
    assert (taken.end, taken.is_stray, taken.frames) == (3, False, 3)


def test_of_a_cycle_that_the_caller_reads_it_has_header_detections_and_age() -> None:
    roles = [*ROLES, FrameRole(FrameKind.AGE, 2)]
    assembly, frames, _ = together([(4, b"ag", 0), header(7, 2), page(7, 1), page(7, 0)], roles)
    (cycle,) = assembly.take(frames, 0, 4, NEVER, ALWAYS).cycles
    unread = cycle.unread
    assert unread is not None
    assert unread.header is not None
    assert unread.age is not None
    assert (unread.announced, unread.header.shape, unread.age.shape) == (2, (1, 64), (1, 64))
    assert (unread.header[0, :3].tobytes(), unread.age[0, :2].tobytes()) == (bytes((7, 0, 2)), b"ag")
    assert unread.detections[:, :2].tolist() == [[7, 0], [7, 1]]
    assembly = Assembly([replace(CLOSED, has_header=False, frames=1)], [SensorHealth()], KNOWN)
    _, frames, _ = together([page(0, 0), end()], ROLES)
    (cycle,) = assembly.take(frames, 0, 2, NEVER, ALWAYS).cycles
    assert cycle.unread is not None
    assert (cycle.unread.announced, cycle.unread.header, cycle.unread.age) == (-1, None, None)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 2)), max_size=60))
def test_whatever_comes_a_scan_is_whole_and_every_frame_is_accounted_for(events: list[tuple[int, int, int]]) -> None:
    health = SensorHealth()
    assembler = Assembled(COUNTED, health)
    used, sent, done = 0, 0, []
    for time, (cycle, slot, what) in enumerate(events):
        frame = header(cycle, 2, at=time) if what == 0 else page(cycle, slot, at=time)
        sent += 1
        result = assembler.add(frame)
        if result is not None:
            done.append(result)
            used += 1 + len(result.slots)
            assert result.slots == sorted(set(result.slots))
            assert len(result.slots) == 2
            assert set(result.cycles) == {result.number}
    assert used + health.repeated + health.wrong_cycle <= sent
    assert health.incomplete <= sent - used
