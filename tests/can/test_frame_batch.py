"""Batches of several buses as one."""

from __future__ import annotations

import can
from hypothesis import given
from hypothesis import strategies as st

from echogrid.can.intake.frames import Frame, FrameBatch

messages = st.builds(
    can.Message,
    timestamp=st.floats(0.0, 1e9),
    arbitration_id=st.integers(0, 0x7FF),
    is_extended_id=st.just(False),
    channel=st.sampled_from(["can0", "can1", "radars", 0, 3, None]),
    data=st.binary(max_size=8),
    is_rx=st.booleans(),
)


@given(groups=st.lists(st.lists(messages, max_size=4), max_size=5), by_time=st.booleans())
def test_joined_are_the_same_frames(groups: list[list[can.Message]], by_time: bool) -> None:
    """In their order, or in that of their times, and each of the batch that it was in."""
    joined, which = FrameBatch.joined([FrameBatch.of(group) for group in groups], by_time=by_time)
    all_of_them = [(number, message) for number, group in enumerate(groups) for message in group]
    if by_time:
        all_of_them.sort(key=lambda one: one[1].timestamp)
    assert which.tolist() == [number for number, _ in all_of_them]
    together = FrameBatch.of([message for _, message in all_of_them])
    assert [tuple(getattr(one, name) for name in Frame.__struct_fields__) for one in joined] == [
        tuple(getattr(one, name) for name in Frame.__struct_fields__) for one in together
    ]
