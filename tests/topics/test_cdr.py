"""What every decoder refuses, whatever its message, and what no encoder can say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.cdr_messages import POINTS_OF_TWO, diagnostics_of, grid_of, odometry_of

from echogrid.topics.cdr import LITTLE_ENDIAN, SECOND
from echogrid.topics.diagnostic_array import decode_diagnostics, encode_diagnostics
from echogrid.topics.grids import Grid, GridUpdate, decode_grid, decode_update, encode_grid, encode_update
from echogrid.topics.points import decode_points, encode_points
from echogrid.topics.poses import decode_odometry, encode_odometry
from echogrid.zenoh.attachment import decode_attachment, decode_grid_attachment, encode_attachment, encode_version

DECODERS = (
    pytest.param(encode_update(GridUpdate(5, "odom", 3, 4, grid_of().occupancy)), decode_update, id="update"),
    pytest.param(encode_points(POINTS_OF_TWO), decode_points, id="points"),
    pytest.param(encode_grid(grid_of()), decode_grid, id="grid"),
    pytest.param(encode_odometry(odometry_of()), decode_odometry, id="odometry"),
    pytest.param(encode_diagnostics(diagnostics_of()), decode_diagnostics, id="diagnostics"),
    pytest.param(encode_attachment(1, 2, bytes(16)), decode_attachment, id="attachment"),
    pytest.param(encode_attachment(1, 2, bytes(16)) + encode_version(3, 4), decode_grid_attachment, id="attachment of a grid"),
)


@pytest.mark.parametrize(("good", "decode"), DECODERS)
def test_every_other_length_is_refused(good: bytes, decode) -> None:
    decode(good)
    for length in range(len(good)):
        with pytest.raises(ValueError, match=r"\w+ \w+"):
            decode(good[:length])
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        decode(good + b"\0")


@pytest.mark.parametrize(("good", "decode"), DECODERS)
def test_hostile_bytes_are_refused_with_value_error(good: bytes, decode) -> None:
    @given(st.binary(max_size=200), st.lists(st.tuples(st.integers(0, len(good) - 1), st.integers(0, 255)), max_size=8))
    def check(noise: bytes, changes: list[tuple[int, int]]) -> None:
        changed = bytearray(good)
        for index, value in changes:
            changed[index] = value
        for payload in (noise, LITTLE_ENDIAN + noise, bytes(changed)):
            try:
                decode(payload)
            except ValueError as error:
                assert type(error) is ValueError  # noqa: PT017  not a UnicodeDecodeError or the like
                assert str(error)  # noqa: PT017

    check()


def test_big_endian_is_refused() -> None:
    with pytest.raises(ValueError, match="00 00 00 00"):
        decode_grid(b"\0\0\0\0" + bytes(200))


def test_what_does_not_fit_into_a_message_is_refused() -> None:
    occupancy = np.zeros((1, 1), dtype=np.int8)
    with pytest.raises(ValueError, match="32-bit seconds"):
        encode_grid(Grid(2**31 * SECOND, "odom", 1.0, (0.0, 0.0), occupancy))
    with pytest.raises(ValueError, match="NUL"):
        encode_grid(Grid(0, "od\0m", 1.0, (0.0, 0.0), occupancy))
    with pytest.raises(ValueError, match="gid of 3 bytes"):
        encode_attachment(1, 0, b"abc")
