"""Frames in a recording: lossless, and read alike by rosbags."""

from __future__ import annotations

from decimal import Decimal

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.mcap_files import decoder

from echogrid.topics.can_frame import decode_frame, encode_frame, stamp_ns
from echogrid.topics.ros_definitions import CAN_FRAME, definition

ATTRIBUTES = [name for name in can.Message.__slots__ if name != "__weakref__"]
DECODE = decoder()
TIMES = st.floats(-(2.0**31) + 1, 2.0**31 - 1)
MESSAGES = st.builds(
    can.Message,
    timestamp=TIMES,
    arbitration_id=st.integers(0, 2**32 - 1),
    is_extended_id=st.booleans(),
    is_remote_frame=st.booleans(),
    is_error_frame=st.booleans(),
    channel=st.none() | st.integers() | st.text(),
    dlc=st.none() | st.integers(0, 64),
    data=st.binary(max_size=64),
    is_fd=st.booleans(),
    is_rx=st.booleans(),
    bitrate_switch=st.booleans(),
    error_state_indicator=st.booleans(),
)


@given(MESSAGES, st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20))
def test_every_attribute_comes_back_and_rosbags_reads_the_same(message: can.Message, bus: str) -> None:
    payload = encode_frame(bus, message)
    back = decode_frame(payload, message.channel)
    length = message.dlc if message.is_remote_frame else len(message.data)
    told = {name: getattr(message, name) for name in ATTRIBUTES} | {"dlc": length}  # in which readers put a length or a code of one
    assert {name: getattr(back, name) for name in ATTRIBUTES} == told
    theirs = DECODE(CAN_FRAME, definition(CAN_FRAME), payload)
    assert (theirs.header.frame_id, theirs.timestamp, theirs.id) == (bus, message.timestamp, message.arbitration_id)
    flags = (theirs.is_extended, theirs.is_remote, theirs.is_error, theirs.is_fd, theirs.bitrate_switch, theirs.error_state, theirs.is_rx)
    assert flags == (
        *(message.is_extended_id, message.is_remote_frame, message.is_error_frame, message.is_fd),
        *(message.bitrate_switch, message.error_state_indicator, message.is_rx),
    )
    assert (theirs.len, theirs.data.tobytes()) == (length, bytes(message.data))
    assert theirs.header.stamp.sec * 10**9 + theirs.header.stamp.nanosec == stamp_ns(message)


@given(TIMES)
def test_a_stamp_is_the_nearest_nanosecond(seconds: float) -> None:
    assert abs(Decimal(seconds) * 10**9 - stamp_ns(can.Message(timestamp=seconds))) <= Decimal("0.5")


def test_what_the_kernel_stamps_is_that_nanosecond_within_what_a_float_holds() -> None:
    assert stamp_ns(can.Message(timestamp=1732547000.125)) == 1732547000125000000


@pytest.mark.parametrize(
    "message", [can.Message(data=bytes(65)), can.Message(arbitration_id=-1), can.Message(dlc=256, is_remote_frame=True)]
)
def test_what_is_no_frame_is_refused(message: can.Message) -> None:
    with pytest.raises(ValueError, match="not a CAN frame"):
        encode_frame("can0", message)


@given(st.binary(max_size=120), st.integers(0, 100))
def test_garbage_is_a_value_error(noise: bytes, cut: int) -> None:
    for data in (noise, encode_frame("can0", can.Message(data=bytes(8)))[:cut]):
        try:
            decode_frame(data, None)
        except ValueError:
            continue
        assert cut >= 60 or data is noise
