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


@given(st.lists(st.lists(messages, max_size=4), max_size=5))
def test_joined_are_the_same_frames_in_the_same_order(groups: list[list[can.Message]]) -> None:
    joined = FrameBatch.joined([FrameBatch.of(group) for group in groups])
    together = FrameBatch.of([message for group in groups for message in group])
    assert [tuple(getattr(one, name) for name in Frame.__struct_fields__) for one in joined] == [
        tuple(getattr(one, name) for name in Frame.__struct_fields__) for one in together
    ]
