"""Frame times against a bit count by hand; arbitration by what must hold of any bus."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from echogrid_training.drives.bus import Request, arbitrate, frame_us, share_out

requests = st.builds(
    Request,
    can_id=st.integers(0, 0x7FF),
    duration_us=st.integers(1, 500),
    due_us=st.integers(0, 5000),
    step_us=st.sampled_from((1, 100)),
)
senders = st.lists(st.lists(requests, max_size=8).map(lambda of: sorted(of, key=lambda one: one.due_us)), min_size=1, max_size=5)


@given(senders)
def test_a_bus_carries_one_frame_at_a_time_and_none_before_it_is_due(senders: list[list[Request]]) -> None:
    ends = arbitrate(senders)
    sent = []
    for requests, times in zip(senders, ends, strict=True):
        assert len(times) == len(requests)
        assert times == sorted(times)
        for request, end in zip(requests, times, strict=True):
            assert end >= request.due_us
            assert (end - request.due_us) % request.step_us == 0
            sent.append((end - request.duration_us, end))
    sent.sort()
    assert all(end <= start for (_, end), (start, _) in itertools.pairwise(sent))


def test_the_lowest_id_goes_first() -> None:
    first, second = Request(0x200, 100, 1000), Request(0x100, 100, 1000)
    assert arbitrate([[first], [second]]) == [[1100], [1000]]


def test_a_frame_that_has_started_is_not_interrupted() -> None:
    assert arbitrate([[Request(0x200, 100, 1000)], [Request(0x100, 100, 1050)]]) == [[1000], [1100]]


@pytest.mark.parametrize(
    ("length", "fd", "least", "most"),
    [
        (8, False, 222, 270),  # 111 bits at 500 kbit/s, at most 24 stuff bits
        (4, False, 158, 190),
        (64, True, 330, 400),  # 30 bits at 500 kbit/s and about 550 at 2 Mbit/s, and stuff bits
        (16, True, 135, 170),
    ],
)
def test_frame_times(length: int, fd: bool, least: int, most: int) -> None:
    assert least <= frame_us(length, fd) <= most


def test_radars_share_the_motion_bus_only_if_all_fit() -> None:
    assert share_out(0.1, [0.15] * 4) == [0, 0, 0, 0]
    assert share_out(0.1, [0.3] * 4) == [1, 1, 2, 2]
    assert share_out(0.1, [0.9, 0.9]) == [1, 2]
