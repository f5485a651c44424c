"""Where frames are that are not where the configuration has them."""

from __future__ import annotations

import pytest

from echogrid.can.database import FrameId
from echogrid.judging.traffic import Heard, Moved, Owner, judge_traffic

BUS = {"can0": ("can0",)}


def heard(*ids: int, count: int = 100) -> Heard:
    return {("can0", (number, False)): count for number in ids}


def radar(first: int, last: int, offset: int) -> Owner:
    """Reads a block of ids, of which the first and the last must be there."""
    every: tuple[FrameId, ...] = tuple((number + offset, False) for number in range(first, last + 1))
    return Owner("one", "can0", (every[0], every[-1]), more=every, offset=offset)


@pytest.mark.parametrize("offset", [-0x20, -8, -1, 1, 4, 8, 0x20])
def test_a_block_that_is_moved_by_less_than_its_length(offset: int) -> None:
    """Some of the ids that are asked for are there, but are its own others."""
    findings, moved = judge_traffic([radar(0x210, 0x21F, offset)], heard(*range(0x210, 0x220)), BUS)
    assert [(one.code, one.value) for one in findings] == [("wrong_id_offset", -offset)]
    assert moved == {"one": Moved("can0", -offset)}


def test_of_places_that_fit_alike_the_round_offset_is_taken() -> None:
    """Three more ids behind the block, as often: the nearest place of four would be another one."""
    _, moved = judge_traffic([radar(0x210, 0x21F, 0x20)], heard(*range(0x210, 0x223)), BUS)
    assert moved == {"one": Moved("can0", -0x20)}


def test_nor_the_place_where_others_send_more_seldom() -> None:
    both = {**heard(*range(0x210, 0x220)), **heard(*range(0x220, 0x230), count=7)}
    _, moved = judge_traffic([radar(0x210, 0x21F, 0x38)], both, BUS)
    assert moved == {"one": Moved("can0", -0x38)}


def test_one_frame_that_is_missing_is_no_other_place() -> None:
    findings, moved = judge_traffic([radar(0x210, 0x21F, 0)], heard(*range(0x210, 0x21F)), BUS)
    assert (findings, moved) == ([], {})
