"""What goes beside a sample: round trips, its very bytes, and those that the document shows."""

from __future__ import annotations

import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from tests.support.cdr_messages import STAMPS
from tests.support.places import DOCS

from echogrid.topics.grids import GridUpdate, encode_update
from echogrid.zenoh.attachment import decode_attachment, decode_grid_attachment, encode_attachment, encode_version


@given(st.integers(-(2**63), 2**63 - 1), STAMPS, st.binary(min_size=16, max_size=16))
def test_attachment_round_trip(sequence: int, stamp_ns: int, gid: bytes) -> None:
    attachment = encode_attachment(sequence, stamp_ns, gid)
    assert len(attachment) == 33
    assert decode_attachment(attachment) == (sequence, stamp_ns, gid)


@given(st.integers(1, 2**63 - 1), STAMPS, st.binary(min_size=16, max_size=16), st.integers(0, 2**32 - 1), st.integers(0, 2**63 - 1))
def test_attachment_of_a_grid_round_trip(sequence: int, stamp_ns: int, gid: bytes, epoch: int, keyframe: int) -> None:
    attachment = encode_attachment(sequence, stamp_ns, gid) + encode_version(epoch, keyframe)
    assert len(attachment) == 45
    assert decode_grid_attachment(attachment) == (sequence, stamp_ns, gid, epoch, keyframe)


def test_attachment_bytes() -> None:
    assert encode_version(2, 258).hex() == "02000000" + "0201000000000000"
    expected = "010000000000000000ca9a3b0000000010" + bytes(range(16)).hex()
    assert encode_attachment(1, 10**9, bytes(range(16))).hex() == expected


def test_the_bytes_in_the_document_are_ours() -> None:
    """Whoever writes a client by them reads what we send."""
    document = (DOCS / "interface.md").read_text()
    lines = re.findall(r"^    ([0-9a-f]{4})  ((?:[0-9a-f]{2} {1,2})*[0-9a-f]{2})(?: {2,}|$)", document, re.MULTILINE)
    second = next(n for n, (at, _) in enumerate(lines) if n and at == "0000")
    update, attachment = (bytes.fromhex("".join(data for _, data in part)) for part in (lines[:second], lines[second:]))
    stamp_ns, gid = 1_700_000_000_123_456_789, bytes(range(0xA0, 0xB0))
    assert update == encode_update(GridUpdate(stamp_ns, "odom", 3, 4, np.array([[97, -1, 50]], np.int8)))
    assert attachment == encode_attachment(7, stamp_ns, gid) + encode_version(2, 41)
    assert [int(at, 16) for at, _ in lines[:second]] == [0, 4, 12, 21, 24, 32, 40]
