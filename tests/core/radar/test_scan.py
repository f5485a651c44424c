"""Scan assembly: every way in which frames go missing, come twice, late, or from another cycle."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from echogrid.core.health import SensorHealth
from echogrid.core.radar.scan import AssemblyRule, Cycle, CycleFrame, FrameKind, ScanAssembler

MS = 1_000_000
COUNTED = AssemblyRule(ends_with_message=False, has_header=True, frames=None, cycle_bits=None, timeout_ns=40 * MS)
CLOSED = AssemblyRule(ends_with_message=True, has_header=True, frames=None, cycle_bits=2, timeout_ns=40 * MS)


def header(cycle: int, expected: int, at: int = 0) -> CycleFrame:
    return CycleFrame(FrameKind.HEADER, b"h", at * MS, cycle, expected=expected)


def page(cycle: int, slot: int, at: int = 1) -> CycleFrame:
    return CycleFrame(FrameKind.DETECTIONS, bytes((slot,)), at * MS, cycle, slot)


def end(at: int = 9) -> CycleFrame:
    return CycleFrame(FrameKind.END, b"e", at * MS, last=True)


def feed(assembler: ScanAssembler, frames: list[CycleFrame]) -> list[Cycle]:
    return [cycle for frame in frames if (cycle := assembler.add(frame)) is not None]


def test_a_cycle_is_whole_with_its_last_page_in_any_order() -> None:
    for order in itertools.permutations(range(3)):
        health = SensorHealth()
        done = feed(ScanAssembler(COUNTED, health), [header(7, 3), *(page(7, slot) for slot in order)])
        assert [frame.slot for frame in done[0].detection_frames()] == [0, 1, 2]
        assert health == SensorHealth()


def test_a_cycle_without_detections_is_whole_with_its_header() -> None:
    assert len(feed(ScanAssembler(COUNTED, SensorHealth()), [header(1, 0), header(2, 0)])) == 2


def test_a_missing_page_gives_the_scan_up_when_the_next_begins() -> None:
    health = SensorHealth()
    done = feed(ScanAssembler(COUNTED, health), [header(1, 2), page(1, 0), header(2, 1), page(2, 0)])
    assert [cycle.header and cycle.header.cycle for cycle in done] == [2]
    assert health == SensorHealth(incomplete=1)


def test_a_page_of_another_cycle_is_no_part_of_this_one() -> None:
    health = SensorHealth()
    assert feed(ScanAssembler(COUNTED, health), [header(2, 2), page(1, 0), page(2, 1)]) == []
    assert health == SensorHealth(wrong_cycle=1)


def test_where_either_states_no_cycle_pages_belong_to_the_open_one() -> None:
    """There is nothing to tell them apart by."""
    for of_header, of_page in ((7, None), (None, 7), (None, None)):
        for rule, frames in ((COUNTED, []), (CLOSED, [end()])):
            health = SensorHealth()
            opening = CycleFrame(FrameKind.HEADER, b"h", 0, of_header, expected=2)
            pages = [CycleFrame(FrameKind.DETECTIONS, bytes((slot,)), MS, of_page, slot) for slot in range(2)]
            assert len(feed(ScanAssembler(rule, health), [opening, *pages, *frames])[0].frames) == 2
            assert health == SensorHealth()


def test_a_page_without_a_header_is_counted() -> None:
    health = SensorHealth()
    assert feed(ScanAssembler(COUNTED, health), [page(1, 0), page(1, 1)]) == []
    assert health == SensorHealth(wrong_cycle=2)


def test_repeated_pages_and_headers_do_not_make_a_scan_whole() -> None:
    health = SensorHealth()
    assembler = ScanAssembler(COUNTED, health)
    assert feed(assembler, [header(1, 2), page(1, 0), page(1, 0), header(1, 2)]) == []
    assert health == SensorHealth(repeated=2)
    assert len(feed(assembler, [page(1, 1)])) == 1


def test_a_frozen_radar_that_repeats_its_last_cycle_makes_no_scan() -> None:
    health = SensorHealth()
    once = [header(5, 1), page(5, 0)]
    assert len(feed(ScanAssembler(COUNTED, health), once * 4)) == 1
    assert health.repeated == 3
    assert health.wrong_cycle == 3


def test_a_cycle_that_takes_too_long_is_given_up() -> None:
    health = SensorHealth()
    done = feed(ScanAssembler(COUNTED, health), [header(1, 2, at=0), page(1, 0, at=1), page(1, 1, at=41)])
    assert done == []
    assert health == SensorHealth(incomplete=1, wrong_cycle=1)


def test_where_the_header_comes_last_pages_of_an_older_cycle_are_sorted_out_at_the_end() -> None:
    """Cycle 6 is 2 in its low two bits; the page that says 1 is left over from cycle 5."""
    health = SensorHealth()
    frames = [page(1, 0), page(2, 1), page(2, 2), header(6, 2), end()]
    done = feed(ScanAssembler(CLOSED, health), frames)
    assert [frame.slot for frame in done[0].detection_frames()] == [1, 2]
    assert health == SensorHealth(wrong_cycle=1)


def test_without_its_header_a_closed_cycle_is_incomplete() -> None:
    health = SensorHealth()
    assert feed(ScanAssembler(CLOSED, health), [page(1, 0), end()]) == []
    assert health == SensorHealth(incomplete=1)


def test_without_any_header_all_slots_make_it_whole() -> None:
    rule = AssemblyRule(ends_with_message=True, has_header=False, frames=2, cycle_bits=None, timeout_ns=40 * MS)
    last = CycleFrame(FrameKind.DETECTIONS, b"1", 2 * MS, None, 1, last=True)
    health = SensorHealth()
    assembler = ScanAssembler(rule, health)
    assert len(feed(assembler, [CycleFrame(FrameKind.DETECTIONS, b"0", MS, None, 0), last])) == 1
    assert feed(assembler, [last]) == []
    assert health == SensorHealth(incomplete=1)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 2)), max_size=60))
def test_whatever_comes_a_scan_is_whole_and_every_frame_is_accounted_for(events: list[tuple[int, int, int]]) -> None:
    health = SensorHealth()
    assembler = ScanAssembler(COUNTED, health)
    used, sent, done = 0, 0, []
    for time, (cycle, slot, what) in enumerate(events):
        frame = header(cycle, 2, at=time) if what == 0 else page(cycle, slot, at=time)
        sent += 1
        result = assembler.add(frame)
        if result is not None:
            done.append(result)
            used += 1 + len(result.frames)
            assert len(result.frames) == 2
            assert all(frame.cycle == result.header.cycle for frame in result.frames.values() if result.header)
    assert used + health.repeated + health.wrong_cycle <= sent
    assert health.incomplete <= sent - used
