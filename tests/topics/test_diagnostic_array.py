"""Diagnostics against rosbags, byte for byte, and against bytes that mean harm."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.cdr_messages import NAMES, ROS, STAMPS, STORE, diagnostics_of, patched, ros_header

from echogrid.topics.diagnostic_array import DiagnosticArray, DiagnosticStatus, Level, decode_diagnostics, encode_diagnostics

DIAGNOSTICS = st.builds(
    DiagnosticArray,
    stamp_ns=STAMPS,
    frame=NAMES,
    status=st.lists(
        st.builds(DiagnosticStatus, st.sampled_from(Level), NAMES, NAMES, NAMES, st.dictionaries(NAMES, NAMES, max_size=4)),
        max_size=4,
    ).map(tuple),
)


def _ros_diagnostics(array: DiagnosticArray) -> object:
    pair = ROS["diagnostic_msgs/msg/KeyValue"]
    status = [
        ROS["diagnostic_msgs/msg/DiagnosticStatus"](
            level=int(status.level),
            name=status.name,
            message=status.message,
            hardware_id=status.hardware_id,
            values=[pair(key=key, value=value) for key, value in status.values.items()],
        )
        for status in array.status
    ]
    return ROS["diagnostic_msgs/msg/DiagnosticArray"](header=ros_header(array.stamp_ns, array.frame), status=status)


@given(DIAGNOSTICS)
def test_diagnostics_are_what_rosbags_writes_and_come_back(array: DiagnosticArray) -> None:
    payload = encode_diagnostics(array)
    assert payload == bytes(STORE.serialize_cdr(_ros_diagnostics(array), "diagnostic_msgs/msg/DiagnosticArray"))
    assert decode_diagnostics(payload) == array


# For the frame "": length 8, number of parts 16, level 20, name's length 24, name 28, message's length 48, hardware_id's 56, pairs 64.
@pytest.mark.parametrize(
    ("at", "layout", "value", "message"),
    [
        (16, "<I", 1, "are left over"),
        (16, "<I", 2**32 - 1, "message ends"),
        (20, "<B", 4, "level of 4"),
        (24, "<I", 2**32 - 1, "name of 4294967295 bytes"),
        (64, "<I", 2**32 - 1, "name of|message ends"),
    ],
)
def test_diagnostics_that_cannot_be_are_refused(at: int, layout: str, value: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        decode_diagnostics(patched(encode_diagnostics(diagnostics_of()), at, layout, value))


def test_of_a_key_that_comes_twice_the_last_counts() -> None:
    """Other programs may write such."""
    pair = ROS["diagnostic_msgs/msg/KeyValue"]
    array = _ros_diagnostics(diagnostics_of())
    array.status[0].values.extend((pair(key="a", value="1"), pair(key="a", value="2")))
    assert decode_diagnostics(bytes(STORE.serialize_cdr(array, "diagnostic_msgs/msg/DiagnosticArray"))).status[0].values == {"a": "2"}
