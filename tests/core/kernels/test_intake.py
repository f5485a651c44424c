"""The compiled way from frames to scans and motion against the reference's: the same bits, whatever comes in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.loops import Fenced, taken_shorter

from echogrid.core.kernels import reference
from echogrid.core.kernels.assembly import Rule, State, integer
from echogrid.core.kernels.can_frames import CLASSIC, CONTROLS, FLEXIBLE, HEAD, LENGTH, STAMP, STAMP_BYTES
from echogrid.core.kernels.frames import Head
from echogrid.core.kernels.plans import MOST_SIGNALS, Plan, Plans
from echogrid.core.kernels.scans import Event, Found, Why, _Room

compiled: Any = pytest.importorskip("echogrid.core.kernels.compiled", reason="no C compiler was at hand when echogrid was installed")
Random = np.random.Generator


def plan(random: Random, columns: int, each: int, names: int) -> Plan:
    """`names` signals of 16 bytes and four flags; quantities of the first three columns at least."""
    places = []
    for _ in range(names * each):
        length, shift = int(random.integers(1, 65)), int(random.integers(0, 8))
        behind, step = (shift + length - 1) // 8, int(random.choice([-1, 1]))
        length = 2 if random.random() < 0.4 else length  # of which flags are often one
        places.append((int(random.integers(0, 16 - behind)) + (behind if step < 0 else 0), step, shift, length, int(random.random() < 0.4)))
    kinds = [
        (*random.integers([0, -1, -1], [names, 2, 4]).tolist(), column)
        for column in range(int(random.integers(min(columns, 3), columns + 1)))
    ]
    flags = [(int(random.integers(names)), 0, 1, 3), (1, 0, 0, 1), (int(random.integers(names)), 1, 0, 2), (0, 1, 2, 2)]
    rows = (*places, *kinds, *flags, (0, 1, 2))
    head = (16, each, int(random.integers(-1, 2)), len(places), len(kinds), len(flags), 3, 0)
    scales = random.choice([1.0, 0.1, -0.02, 3e8, 1e-7], 2 * (len(places) + len(kinds)))
    return Plan((*head, *(one for row in rows for one in row)), tuple(scales.tolist()))


@given(payload=st.binary(min_size=8, max_size=8), length=st.integers(1, 8), first=st.integers(0, 7), is_signed=st.booleans())
def test_an_integer_is_what_python_reads_in_its_bytes(payload: bytes, length: int, first: int, is_signed: bool) -> None:
    length = min(length, 8 - first)
    raw, some = np.frombuffer(payload, np.uint8), payload[first : first + length]
    for step, at, order in ((1, first, "little"), (-1, first + length - 1, "big")):
        expected = int.from_bytes(some, order, signed=is_signed)  # type: ignore[arg-type]
        expected = (expected + 2**63) % 2**64 - 2**63
        assert integer(raw, np.array((at, step, 0, 8 * length, is_signed))) == expected


def assembling(random: Random, size: int) -> list[Any]:
    """Frames of four radars: with a header that counts, closed by a message, without a header, and one that the caller reads.
    Bytes: cycle, slot, count."""
    known = [(0, 0, 3, -1, 0), (0, 1, 3, -1, 0), (0, 3, 2, -1, 0), (-1, 0, 0, -1, 0), (1, 1, 2, 0, 0), (1, 1, 2, 1, 0)]
    known += [(1, 0, 3, -1, 0), (1, 2, 1, -1, 1), (2, 1, 3, 0, 0), (2, 1, 3, 1, 1), (3, 1, 3, 0, 1)]
    plans = Plans()
    first, second, third = (plans.add(plan(random, 4, each, names)) for each, names in ((2, 5), (1, 6), (3, 4)))
    values, age = plans.add(plan(random, 3, 1, 5)), plans.add(plan(random, 3, 1, 4))
    rules = [(0, 1, -1, -1, 40, 2, first, values, age, 1, 3, 4, 0, 1, 3), (1, 1, -1, 3, 40, 1, second, values, -1, 99, 2, 3, 2, 0, 0)]
    rules[0] = (*rules[0][:2], int(random.choice([-1, -1, 1, 2])), *rules[0][3:])  # fewer frames than its header says, or more
    bits = int(random.choice([1, 2]))  # of the header's number that the second radar's detections have
    rules[1] = (*rules[1][:3], 2**bits - 1, *rules[1][4:])
    rules += [(1, 0, 2, -1, 40, 1, third, -1, -1, 1, 3, 0, -1, 0, 0), (1, 0, 1, -1, 40, 1, -1, -1, -1, 99, 3, 0, -1, 0, 0)]
    byte, none = [[place, 1, 0, 8, 0] for place in range(3)], [0, 1, 0, 0, 0]
    motorola = [1, -1, 4, 4, 1]
    cycle = [0, 1, 0, int(random.choice([1, 8, 8])), 0]
    fields = [
        [cycle, cycle, byte[1], [2, -1, 0, 16, 0], byte[2], none],
        [byte[0], [0, 1, 0, bits, 0], none, byte[0], byte[2], motorola],
    ]
    fields += [[none] * 6] * 2
    sizes = random.choice([3, 3, 3, 3, 3, 3, 1, 8], size).astype(np.uint8)
    data = random.choice([0, 1, 1, 2, 3], 8 * size + 1).astype(np.uint8)
    received = np.cumsum(random.integers(-1, 9, size)).astype(np.int64) + random.choice([0, 0, 0, 0, 70], size)
    roles = random.integers(-1, len(known), size)
    sorts = random.choice([0, 1, 1, 1, 1, 1, 3, 5, 9], size).astype(np.uint8)
    wrong, begins = random.random(size) < 0.05, np.arange(size, dtype=np.int64) * 8
    state = [np.zeros((4, 12), np.int64), *np.zeros((2, 4, 4), np.int64), np.zeros((4, 7, 64), np.uint8), np.zeros((4, 5), np.int64)]
    given = [np.array(known, np.int64), np.array(rules, np.int64), np.array(fields, np.int64)]
    first = random.choice([-5, *received[:1], *received[: size // 2]])
    event = np.array([0, random.choice([-(2**63), 0]), first, random.choice([50, 900]), size, 60, *[0] * 8])
    rows, columns, bytes_ = random.integers([1, 15, 384], [6, 32, 900]).tolist()  # one cycle has room in any case
    room = [np.zeros((rows, 13), np.int64), np.zeros((rows, 3)), np.zeros((4, columns)), np.zeros(bytes_, np.uint8)]
    frames = [received, roles, sorts, wrong, sizes, begins, data]
    return [*frames, *given, *state, *plans.arrays(), 1e9, event, *room]


EVENT, SCANS, COLUMNS, SUMMED = 18, 19, 21, 22  # among the arguments


def stepped(arguments: list[Any]) -> bool:
    """Makes ready to go on as the caller would; whether there is something left."""
    event = arguments[EVENT]
    if event[Event.WHY] == Why.IS_DUE:
        event[Event.SPAN_END] = event[Event.NEWEST] + 120
    elif event[Event.WHY] == Why.IS_STRAY:
        event[Event.NEWEST] = arguments[0][event[Event.AT]]
        event[Event.SPAN_END] = event[Event.NEWEST] + 120
    return bool(event[Event.AT] < event[Event.UNTIL])


@settings(max_examples=40)
@given(seed=st.integers(0, 1 << 32), size=st.integers(0, 90))
def test_frames_become_scans_as_in_numpy(seed: int, size: int) -> None:
    fenced, expected = Fenced(assembling(np.random.default_rng(seed), size)), assembling(np.random.default_rng(seed), size)
    found = fenced.arguments
    while stepped(expected) and stepped(found):
        compiled.assemble(*found)
        assert fenced.is_whole
        with np.errstate(all="ignore"):
            reference.assemble(*expected)
        scans, detections, bytes_there = expected[EVENT][Event.SCANS : Event.LOST].tolist()
        ends = {SCANS: np.s_[:scans], SCANS + 1: np.s_[:scans], COLUMNS: np.s_[:, :detections], SUMMED: np.s_[:bytes_there]}
        for place, (one, other) in enumerate(zip(found, expected, strict=True)):
            some = ends.get(place, ...)
            np.testing.assert_array_equal(one if np.isscalar(one) else one[some], other if np.isscalar(other) else other[some])


def one_radar(roles: list[tuple[int, ...]], ranges: list[list[int]], most: int) -> list[Any]:
    """Frames of a radar without a header whose cycle two frames make, of six detections in each: a byte is range, azimuth and range rate
    of one; the RCS is not said. Behind the columns of detections lie others."""
    places, kinds = [(k, 1, 0, 8, 0) for k in range(6)], [(0, -1, -1, column) for column in range(3)]
    plans = Plans()
    plans.add(Plan((6, 6, -1, 6, 3, 0, 0, 0, *(one for row in (*places, *kinds) for one in row)), (1.0, 0.0) * 9))
    size = len(ranges)
    frames = [np.arange(size), np.arange(size) % 2, np.ones(size, np.uint8), np.zeros(size, np.bool_), np.full(size, 6, np.uint8)]
    rule = np.array([(1, 0, 2, -1, 40, 6, 0, -1, -1, most, 6, 0, -1, 0, 0)])
    given = [np.arange(size) * 6, np.array(ranges, np.uint8).reshape(-1), np.array(roles), rule, np.tile((0, 1, 0, 0, 0), (1, 6, 1))]
    state = [np.zeros((1, 12), np.int64), *np.zeros((2, 1, 4), np.int64), np.zeros((1, 7, 64), np.uint8), np.zeros((1, 5), np.int64)]
    event = np.array([0, -(2**63), -5, 900, size, 60, *[0] * 8])
    columns = np.arange(6 * 40).reshape(6, 40) + 0.5
    return [
        *frames,
        *given,
        *state,
        *plans.arrays(),
        1e9,
        event,
        np.zeros((4, 13), np.int64),
        np.zeros((4, 3)),
        columns[:4],
        np.zeros(900, np.uint8),
    ]


@pytest.mark.parametrize("loops", [reference, compiled])
def test_of_too_many_detections_the_nearest_stay_in_their_order(loops: Any) -> None:
    """Of those as near as each other the first; one at 0 m says nothing. Two cycles, one behind the other."""
    ranges = [[2, 4, 7, 4, 30, 8], [0, 12, 4, 40, 3, 9], [5, 5, 5, 5, 5, 5], [9, 2, 9, 9, 9, 9]]
    arguments = one_radar([(0, 1, 6, 0, 0), (0, 1, 6, 1, 1)], ranges, 4)
    with np.errstate(all="ignore"):
        loops.assemble(*arguments)
    found, columns = arguments[SCANS][:2], arguments[COLUMNS]
    assert found[:, [Found.BEGIN, Found.END, Found.INVALID, Found.TRUNCATED]].tolist() == [[0, 4, 1, 7], [4, 8, 0, 8]]
    assert columns[:3, :8].tolist() == [[2, 4, 4, 3, 5, 5, 5, 2]] * 3
    assert np.isnan(columns[3, :8]).all()
    np.testing.assert_array_equal(columns.base[4:], np.arange(4 * 40, 6 * 40).reshape(2, 40) + 0.5)


@pytest.mark.parametrize("loops", [reference, compiled])
def test_a_frame_that_comes_twice_ends_no_cycle(loops: Any) -> None:
    """Though it is of the kind that does: it is the first one's place once more."""
    arguments = one_radar([(0, 1, 6, 0, 0), (0, 1, 6, 0, 1)], [[1] * 6, [2] * 6], 9)
    loops.assemble(*arguments)
    assert arguments[EVENT][Event.SCANS] == 0
    assert arguments[14][0].tolist() == [1, 0, 0, 0, 0]  # repeated, of what is counted
    assert arguments[10][0, State.OPEN] == 1


@pytest.mark.parametrize("loops", [reference, compiled])
@pytest.mark.parametrize(("later", "taken"), [(60, 2), (61, 1), (-60, 2), (-61, 1)])
def test_a_frame_of_another_time_is_a_stray_from_the_first_nanosecond_beyond_a_step(loops: Any, later: int, taken: int) -> None:
    arguments = one_radar([(0, 1, 6, 0, 0), (0, 1, 6, 1, 1)], [[1] * 6, [2] * 6], 9)
    arguments[0][:] = 100, 100 + later
    arguments[EVENT][Event.SPAN_FIRST] = -(2**63)
    loops.assemble(*arguments)
    assert arguments[EVENT][[Event.TAKEN, Event.AT]].tolist() == [taken, taken]
    assert arguments[EVENT][Event.WHY] == (Why.IS_STRAY if taken < 2 else Why.ALL_TAKEN)


@pytest.mark.parametrize("loops", [reference, compiled])
def test_detections_that_the_caller_reads_need_no_columns(loops: Any) -> None:
    arguments = one_radar([(0, 1, 6, 0, 0), (0, 1, 6, 1, 1)], [[1] * 6, [2] * 6], 9)
    arguments[8][0, Rule.PLAN], arguments[COLUMNS] = -1, np.zeros((4, 0))
    loops.assemble(*arguments)
    assert (arguments[EVENT][Event.SCANS], arguments[EVENT][Event.WHY]) == (1, Why.IS_UNREAD)


def test_among_the_cycles_that_are_put_together_are_whole_ones_of_all_radars() -> None:
    """Else the test above says little: and all reasons to end, detections that say something, too many, and checksums."""
    whole, why, said, too_many, sums = set(), set(), 0, 0, 0
    for seed in range(25):
        given = assembling(np.random.default_rng(seed), 200)
        while stepped(given):
            with np.errstate(all="ignore"):
                reference.assemble(*given)
            why.add(Why(given[EVENT][Event.WHY]))
            for row in given[SCANS][: given[EVENT][Event.SCANS]]:
                whole.add(int(row[Found.RADAR]))
                said += int(row[Found.END] - row[Found.BEGIN])
                too_many, sums = too_many + int(row[Found.TRUNCATED]), sums + int(row[Found.SUM_BEGIN] >= 0)
    assert whole == {0, 1, 2, 3}
    assert why == set(Why)
    assert min(said, too_many, sums) > 3


@pytest.mark.parametrize(
    ("is_open", "frames", "plan_at", "columns", "size", "scans", "fits"),
    [
        (1, 1, 0, 10, 292, 1, True),  # 4 there and 2 frames of 3; 100 bytes there, two frames and a header of 64
        (1, 1, 0, 9, 292, 1, False),
        (1, 1, 0, 10, 291, 1, False),
        (1, 1, 0, 10, 292, 0, False),
        (1, 2, 0, 10, 900, 1, False),
        (0, 2, 0, 7, 228, 1, True),  # the next frame opens a cycle, whatever the last one had
        (0, 2, 0, 6, 228, 1, False),
        (0, 2, 0, 7, 227, 1, False),
        (1, 3, -1, 4, 420, 1, True),  # detections that the caller reads take no columns
        (1, 3, -1, 4, 419, 1, False),
    ],
)
def test_room_for_the_next_frame_is_counted(
    is_open: int, frames: int, plan_at: int, columns: int, size: int, scans: int, fits: bool
) -> None:
    room = _Room(np.zeros((2, 13), np.int64), np.zeros((2, 3)), np.zeros((4, columns)), np.zeros(size, np.uint8))
    room.scans_there, room.used, room.bytes = 2 - scans, 4, 100
    state, rule, plans = np.zeros(12, np.int64), np.zeros(15, np.int64), np.zeros(8, np.int64)
    state[State.OPEN], state[State.FRAMES], rule[Rule.PLAN], plans[Head.EACH] = is_open, frames, plan_at, 3
    assert room.has_for(state, rule, plans) == fits


def identifying(random: Random, size: int) -> list[Any]:
    """Frames of two buses: of radars with and without a checksum of their own, of motion, and nobody's."""
    plans = Plans()
    both = (plan(random, 2, 1, 5), plan(random, 1, 1, 4))
    if random.random() < 0.5:
        wheels, yaw = map(plans.add, both)
    else:
        yaw, wheels = map(plans.add, both[::-1])
    keys = np.sort(
        random.choice([bus << 33 | extended << 32 | code for bus in (0, 1) for extended in (0, 1) for code in range(5)], 7, replace=False)
    )
    none = [0, 1, 0, 0, 0]
    known = np.array([(0, 1, 2, -1, 0)] * 3 + [(-1, 0, 0, -1, 0)] * 5)
    checks = np.array(
        [(-1, 0, *none), (0, 6, 1, 1, 0, 8, 0), (6, 16, 3, -1, 0, 16, 0), (-1, 0, *none), (0, 6, 5, 1, 0, 8, 1), *[(-1, 0, *none)] * 3]
    )
    says = np.array([[-1, -1, -1, *none, *none]] * 8)
    says[3], says[4] = (16, wheels, -1, 15, 1, 4, 4, 0, *none), (16, wheels, yaw, *none, 3, -1, 0, 12, 1)
    says[5] = (16, -1, yaw, 7, 1, 0, 8, 1, 7, 1, 0, 8, 0)
    known, checks, says = (np.roll(one, 5, axis=0) for one in (known, checks, says))  # the first is no radar's
    tables = random.integers(0, 4, (22, 256)).astype(np.uint64)
    tables[random.random(tables.shape) < 0.1] |= np.uint64(1 << 40)
    sizes = random.choice([16, 16, 16, 5, 64], size).astype(np.uint8)
    stamps = random.choice([0.0, 1.6e9, np.nan, np.inf, -5e9, -1.25, 4.59e9, 4.6e9], size) + random.random(size).round(
        random.integers(0, 9)
    )
    flags = random.choice([0, 1, 8, 2, 4, 9], size).astype(np.uint8)
    data = random.integers(0, 4, 64 * size + 1).astype(np.uint8)
    batch = [stamps, random.integers(0, 6, size).astype(np.uint32), flags, sizes, np.arange(size, dtype=np.int64) * 64, data]
    written = [np.full(size, 9), np.full(size, 9), np.full(size, 9, np.uint8), np.ones(size, np.bool_)]
    readers = [random.integers(-1, 2, size), keys, random.permutation(8)[:7], known, checks, tables, says, *plans.arrays(), 1e9]
    return [*batch, *readers, *written, np.full((size, 3), 9.0), np.full((size, 2), 9)]


@given(seed=st.integers(0, 1 << 32), size=st.integers(0, 80))
def test_frames_are_identified_as_in_numpy(seed: int, size: int) -> None:
    fenced, expected = Fenced(identifying(np.random.default_rng(seed), size)), identifying(np.random.default_rng(seed), size)
    found = fenced.arguments
    compiled.identify(*found)
    assert fenced.is_whole
    with np.errstate(all="ignore"):
        reference.identify(*expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def receiving(random: Random, size: int) -> list[Any]:
    """Frames as Linux has them, classic and FD, with any bits, some without a stamp."""
    rows = random.integers(0, 256, (size, FLEXIBLE)).astype(np.uint8)
    heads, stamps = random.integers(-(1 << 31), 1 << 31, (size, HEAD)).astype(np.int32), random.integers(0, 1 << 40, (size, STAMP))
    heads[:, LENGTH], heads[:, CONTROLS] = random.choice([CLASSIC, FLEXIBLE], size), random.choice([0, STAMP_BYTES], size, p=[0.2, 0.8])
    written = [np.full(size, 9.0), np.full(size, 9, np.uint32), *np.full((3, size), 9, np.uint8), np.full(size * FLEXIBLE, 9, np.uint8)]
    return [rows, heads, stamps, *written]


@given(seed=st.integers(0, 1 << 32), size=st.integers(0, 40))
def test_frames_of_a_socket_are_read_as_in_numpy(seed: int, size: int) -> None:
    """Which is held to what python-can makes of them by tests/can/test_socketcan.py."""
    fenced, expected = Fenced(receiving(np.random.default_rng(seed), size)), receiving(np.random.default_rng(seed), size)
    found = fenced.arguments
    compiled.can_frames(*found)
    assert fenced.is_whole
    reference.can_frames(*expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def joining(random: Random, size: int) -> list[Any]:
    """Columns of `size` frames in four batches, one of them empty perhaps, in any order."""
    cuts = np.sort(random.integers(0, size + 1, 3))
    starts = np.array([0, *cuts])
    kinds = (np.float64, np.uint32, np.uint8, np.uint8, np.uint8, np.int64, np.int32)
    columns = [np.split(random.integers(0, 200, size).astype(kind), cuts) for kind in kinds]
    columns[-1] = [one - 4 for one in columns[-1]]  # names, none and numbers
    written = [np.full(size, 9, kind) for kind in (*kinds, np.int64)]
    return [random.permutation(size), starts, random.integers(-9, 9, (2, 4)), *columns, *written]


@given(seed=st.integers(0, 1 << 32), size=st.integers(0, 40))
def test_batches_are_joined_as_in_numpy(seed: int, size: int) -> None:
    """Which is held to what the frames are one by one by tests/can/test_frame_batch.py."""
    fenced, expected = Fenced(joining(np.random.default_rng(seed), size)), joining(np.random.default_rng(seed), size)
    compiled.join_frames(*fenced.arguments)
    assert fenced.is_whole
    reference.join_frames(*expected)
    for one, other in zip(fenced.arguments[-8:], expected[-8:], strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("place", [-1, 11])
def test_a_frame_that_no_batch_has_is_not_joined(place: int) -> None:
    arguments = joining(np.random.default_rng(0), 11)
    arguments[0][3] = place
    with pytest.raises(ValueError, match="belong together"):
        compiled.join_frames(*arguments)


@pytest.mark.parametrize(("more", "is_refused"), [(0, False), (1, True)])
def test_a_plan_has_at_most_so_many_signals(more: int, is_refused: bool) -> None:
    """As many as the reader of a profile may ask for."""
    count = MOST_SIGNALS + more
    head = (16, 1, -1, count, 0, 0, 0, 0)
    plans = Plans()
    plans.add(Plan((*head, *(0, 1, 0, 8, 0) * count), (1.0, 0.0) * count))
    arguments = identifying(np.random.default_rng(0), 9)
    arguments[12][:, 1:3] = np.where(arguments[12][:, 1:3] < 0, -1, 0)
    arguments[13:15] = plans.arrays()
    if is_refused:
        with pytest.raises(ValueError, match="belong together"):
            compiled.identify(*arguments)
    else:
        compiled.identify(*arguments)


# A plan of two signals, two quantities and a flag: its head, the signals' places, quantities, the flag and its two numbers.
SOUND = (16, 1, 0, 2, 2, 1, 2, 0, *(0, 1, 0, 8, 0), *(8, 1, 0, 8, 0), *(0, -1, -1, 0), *(1, 0, -1, 1), *(1, 1, 0, 2), 3, 4)
EDGES = {2: (-1,), 8: (1024, -1024), 9: (-1,), 10: (0, 7), 11: (0, 64), 18: (1,), 19: (0,), 20: (0,), 21: (1,), 26: (0,), 28: (2,)}
BEYOND = {0: (-1, 17), 1: (-1, 0, 2), 2: (1,), 3: (-1, 129), 4: (-1, 3), 5: (-1, 2), 6: (-1, 3), 7: (-1, 1)}
BEYOND |= {8: (1025, -1025), 9: (0, 2), 10: (-1, 8), 11: (-1, 65)}
BEYOND |= {18: (-1, 2), 19: (1,), 20: (1,), 21: (-1, 2), 26: (-1, 2), 28: (-1,), 29: (3,)}


def with_plan(place: int, value: int) -> list[Any]:
    """Frames of identify with that plan for the wheels, one number of it changed."""
    numbers = list(SOUND)
    numbers[place] = value
    arguments = identifying(np.random.default_rng(0), 9)
    arguments[12][:, 1:3] = -1
    arguments[12][0, 1] = 0
    arguments[13:15] = np.array(numbers, np.int64), np.ones(8)
    return arguments


@pytest.mark.parametrize(("place", "value"), [(place, value) for place, values in EDGES.items() for value in values])
def test_a_plan_at_the_edge_of_its_arrays_is_read_as_in_numpy(place: int, value: int) -> None:
    """Of small numbers, so that no bit of 64 is rounded away."""
    found, expected = with_plan(place, value), with_plan(place, value)
    for arguments in (found, expected):
        arguments[1][:], arguments[2][:], arguments[5][np.arange(len(arguments[5])) % 8 > 0] = (
            arguments[7][0] & 7,
            arguments[7][0] >> 32 & 1,
            0,
        )
        arguments[6][:], arguments[8][0] = arguments[7][0] >> 33, 0
        arguments[5][::64], arguments[5][8::64] = np.arange(10), 3  # odd and even ones of sound frames
    compiled.identify(*found)
    assert (found[17] == 0).all()
    if place == 8:  # so far from the payload numpy does not look
        return
    with np.errstate(all="ignore"):
        reference.identify(*expected)
    np.testing.assert_array_equal(found[20], expected[20])


@pytest.mark.parametrize(("place", "value"), [(place, value) for place, values in BEYOND.items() for value in values])
def test_a_plan_that_reads_or_writes_beyond_is_refused(place: int, value: int) -> None:
    with pytest.raises(ValueError, match="belong together"):
        compiled.identify(*with_plan(place, value))


def test_a_plan_of_the_yaw_rate_has_one_column() -> None:
    """A second would be the next frame's speed, or what lies behind the last."""
    for column, is_refused in ((0, False), (1, True)):
        arguments = with_plan(21, column)
        arguments[12][0, 1], arguments[12][0, 2] = -1, 0
        arguments[13][25] = 0
        if is_refused:
            with pytest.raises(ValueError, match="belong together"):
                compiled.identify(*arguments)
        else:
            compiled.identify(*arguments)


@pytest.mark.parametrize(
    ("array", "place", "value"),
    [
        *((4, 8, -1), (4, 8, 64 * 9 + 1), (8, 6, -1), (8, 6, 8)),  # where bytes begin; rows
        *((10, (6, 0), 17), (10, (6, 1), -1), (10, (6, 3), 0), (10, (7, 0), 7)),  # checksums
        *((12, (0, 0), 15), (12, (0, 4), 0), (12, (0, 9), 0), (12, (0, 6), 65), (12, (0, 11), 65)),  # what motion frames say
    ],
)
def test_numbers_that_lead_beyond_an_array_are_refused(array: int, place: Any, value: int) -> None:
    arguments = identifying(np.random.default_rng(0), 9)
    compiled.identify(*arguments)
    arguments[array][place] = value
    with pytest.raises(ValueError, match="belong together"):
        compiled.identify(*arguments)


@pytest.mark.parametrize(("case", "place"), [("identify", 11), ("identify", 9), ("assemble", 8), ("assemble", 15), ("assemble", 21)])
def test_plans_and_tables_that_reach_beyond_the_arrays_are_refused(case: str, place: int) -> None:
    """Half of the checksums' tables, of what is known, of the rules, of the plans, of the room for detections."""
    arguments = (identifying if case == "identify" else assembling)(np.random.default_rng(0), 9)
    arguments[place] = arguments[place][: len(arguments[place]) // 2]
    with pytest.raises(ValueError, match="belong together"):
        getattr(compiled, case)(*arguments)


@pytest.mark.parametrize(
    ("name", "case", "free"),
    [
        ("identify", identifying, {(5, 0)}),  # bytes behind the last frame's
        ("assemble", assembling, {(6, 0), (9, 1), (22, 0)}),  # the same, counts of a header, room
        ("can_frames", receiving, set()),
        ("join_frames", joining, set()),
    ],
)
def test_an_array_that_is_one_shorter_than_the_others_say_is_refused(
    name: str, case: Callable[[Random, int], list[Any]], free: set[tuple[int, int]]
) -> None:
    assert taken_shorter(getattr(compiled, name), case(np.random.default_rng(3), 11)) == free


def test_a_field_of_a_radar_that_lies_beyond_a_frame_is_refused() -> None:
    """Each of them, of each radar."""
    arguments = assembling(np.random.default_rng(0), 9)
    fields = arguments[9]
    for radar, field in np.ndindex(fields.shape[:2]):
        arguments[9] = fields.copy()
        arguments[9][radar, field, 3] = 65
        with pytest.raises(ValueError, match="belong together"):
            compiled.assemble(*arguments)
